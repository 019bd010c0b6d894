// The speed and accuracy panel: each image's time against its error, what the server chose and left out, and the latency from sky
// to screen by stage. insight_model.js has the numbers, insight_draw.js the drawings.

import { colours, make, setText } from './dom.js';
import { STAGE_COLOURS, drawForm, drawLatency, drawScatter, stageLabels, styleOf } from './insight_draw.js';
import { isSeen } from './panels.js';
import { Insight, MINUTES, choiceWords, rows, summary } from './insight_model.js';

const SHOW_MS = 500;

class Panel {
  constructor(app) {
    this.insight = new Insight();
    this.methods = []; // in order of appearance: each keeps its shape and colour
    this.session = null;
    this.build(app.panel('insight', 'Speed and accuracy'));
    app.on('picture', ({ header, clock, nowMs }) =>
      this.insight.picture(header, clock.known ? nowMs * 1000 + clock.offsetUs : NaN, performance.now()));
    app.on('status', (status) => this.takeStatus(status));
    app.on('welcome', (welcome) => {
      if (welcome.session !== this.session) this.insight.forget();
      this.insight.headers.length = 0; // sequence numbers restart
      this.session = welcome.session;
    });
    setInterval(() => this.show(), SHOW_MS);
    window.relight.insight = this;
  }

  build(body) {
    this.words = make('p', { className: 'counts', id: 'insight-words' });
    this.time = make('select', { id: 'insight-time' },
      make('option', { value: 'shaded', text: 'relighting' }), make('option', { value: 'whole', text: 'server total' }));
    this.scatter = make('canvas', { id: 'insight-scatter', attributes: { role: 'img' } });
    this.latency = make('canvas', { id: 'insight-latency', attributes: { role: 'img' } });
    this.legend = make('ul', { className: 'insight-legend', id: 'insight-methods' });
    this.choices = make('ol', { className: 'counts insight-choices', id: 'insight-choices' });
    this.stages = make('ul', { className: 'insight-legend', id: 'insight-stages' });
    this.table = make('tbody', { id: 'insight-table' });
    this.time.onchange = () => this.show();
    body.append(
      make('label', { className: 'insight-row' }, 'Error against time: ', this.time),
      this.scatter, this.legend, this.words,
      make('h3', { text: 'Choices, newest first' }), this.choices,
      make('h3', { text: 'Latency from sky to screen' }), this.latency, this.stages,
      make('details', {}, make('summary', { text: 'Latest values as a table' }),
        make('table', { className: 'insight-table' }, make('caption', { className: 'unseen', text: 'The newest image, and the latency of the last second' }), this.table)));
    this.stages.replaceChildren(...stageLabels.map((label, i) => this.item(label, 'square', STAGE_COLOURS[i])));
  }

  item(label, form, colour) {
    const attributes = { 'aria-hidden': 'true', 'data-form': form, 'data-colour': colour };
    const sign = make('canvas', { width: 22, height: 22, className: 'insight-sign', attributes });
    return make('li', {}, sign, label);
  }

  takeStatus(status) {
    const point = this.insight.status(status, performance.now());
    if (!point || this.methods.includes(point.method)) return;
    this.methods.push(point.method);
    const { form, colour } = styleOf(this.methods.length - 1);
    this.legend.append(this.item(point.method, form, colour));
  }

  show() {
    if (!isSeen(this.scatter)) return;
    const now = performance.now();
    const { insight } = this;
    const whole = this.time.value === 'whole';
    drawScatter(this.scatter, insight, this.methods, whole);
    drawLatency(this.latency, insight.seconds, now);
    this.paintSigns();
    const said = summary(insight, whole);
    setText(this.words, said);
    this.scatter.setAttribute('aria-label', `Error against time of each image of the last ${MINUTES} minutes. ${said}`);
    const table = rows(insight);
    this.latency.setAttribute('aria-label', `Latency over time, by stage. ${table.filter(([label]) => label.startsWith('Latency')).map((r) => r.join(': ')).join('; ')}`);
    this.fill(this.choices, [...insight.choices].reverse().map((c) => choiceWords(c, now)), (words) => make('li', { text: words }));
    this.fill(this.table, table, ([label, value]) => make('tr', {}, make('th', { text: label, scope: 'row' }), make('td', { text: value })));
  }

  fill(element, items, row) {
    const key = JSON.stringify(items);
    if (element.dataset.key === key) return;
    element.dataset.key = key;
    element.replaceChildren(...items.map(row));
  }

  paintSigns() {
    const colour = colours();
    for (const sign of document.querySelectorAll('.insight-sign')) {
      const context = sign.getContext('2d');
      context.clearRect(0, 0, 22, 22);
      context.fillStyle = context.strokeStyle = colour(sign.dataset.colour);
      context.lineWidth = 3;
      drawForm(context, sign.dataset.form, 11, 11, 8);
      if (sign.dataset.form === 'cross') context.stroke();
      else context.fill();
    }
  }
}

export function mount(app) {
  document.head.append(make('link', { rel: 'stylesheet', href: 'insight.css' }));
  return new Panel(app);
}
