// Changed pixels over the picture: the server's change maps (PROTOCOL.md 6.8), over a second connection while they are shown.

import { make, setText } from './dom.js';
import { PATH, PROTOCOL, VERSION, decodePicture } from './js/protocol.js';
import { wishedRole } from './role.js';

const AGAIN_MS = 2000;

// Shares of a map's pixels, from RGBA: {changed, computed, traced}.
export function sharesOf({ data }) {
  const count = [0, 0, 0];
  for (let i = 0; i < data.length; i += 4) for (let c = 0; c < 3; c++) count[c] += data[i + c] > 0 ? 1 : 0;
  const [changed, computed, traced] = count.map((n) => (4 * n) / data.length);
  return { changed, computed, traced };
}

// Shows a share truthfully: only none is 0 %, only all is 100 %.
export function percent(share) {
  if (share > 0 && share < 0.001) return 'less than 0.1 %';
  if (share < 1 && share > 0.999) return 'more than 99.9 %';
  return `${Number((100 * share).toFixed(1))} %`;
}

export const words = ({ changed, computed, traced }) =>
  `${percent(changed)} of the pixels changed (red). Light was computed for ${percent(computed)} (green)` +
  `${traced > 0 ? `, with rays to the sun for ${percent(traced)} (blue)` : ''}.`;

class Changes {
  constructor(app) {
    this.app = app;
    this.box = make('input', { type: 'checkbox', id: 'changes-shown' });
    this.line = make('p', { className: 'counts', id: 'changes-words' });
    this.canvas = make('canvas', { id: 'changes-map', hidden: true, attributes: { 'aria-hidden': 'true' } });
    app.canvas.after(this.canvas);
    this.place = document.getElementById('insight').querySelector('.panel-body');
    this.place.append(make('label', { className: 'insight-row' }, this.box, 'Show which pixels changed'), this.line);
    this.box.onchange = () => (this.box.checked ? this.open() : this.close());
    window.relight.changes = this;
  }

  open() {
    const socket = new WebSocket(new URL(PATH, location.href.replace(/^http/, 'ws')).href, PROTOCOL);
    this.socket = socket;
    const say = (message) => socket.send(JSON.stringify(message));
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => say({ op: 'hello', role: this.app.role ?? 'viewer', version: VERSION, token: wishedRole(location).token });
    socket.onclose = () => {
      if (this.socket === socket) this.retry = setTimeout(() => this.open(), AGAIN_MS);
    };
    socket.onmessage = async ({ data }) => {
      if (typeof data === 'string') {
        const message = JSON.parse(data);
        if (message.op !== 'welcome') return;
        if (message.formats.includes('changes')) say({ op: 'subscribe', format: 'changes' });
        else this.close('This server does not report which pixels changed.');
        return;
      }
      const picture = decodePicture(data);
      if (picture.ok && this.socket === socket) await this.draw(picture);
      if (socket.readyState === WebSocket.OPEN) say({ op: 'ack', sequence: picture.header?.sequence ?? picture.sequence });
    };
    setText(this.line, 'The next image shows what changed.');
  }

  // Red: changed; where light was taken over nothing is painted.
  async draw({ payload }) {
    const bitmap = await createImageBitmap(new Blob([payload], { type: 'image/png' }));
    Object.assign(this.canvas, { width: bitmap.width, height: bitmap.height, hidden: !this.box.checked });
    const context = this.canvas.getContext('2d', { willReadFrequently: true });
    context.drawImage(bitmap, 0, 0);
    bitmap.close();
    const map = context.getImageData(0, 0, this.canvas.width, this.canvas.height);
    setText(this.line, words(sharesOf(map)));
    for (let i = 0; i < map.data.length; i += 4) map.data[i + 3] = map.data[i] || map.data[i + 1] || map.data[i + 2] ? 110 : 0;
    context.putImageData(map, 0, 0);
  }

  close(why = '') {
    const { socket } = this;
    clearTimeout(this.retry);
    this.socket = null;
    socket?.close();
    this.box.checked = false;
    this.canvas.hidden = true;
    setText(this.line, why);
  }
}

export const mount = (app) => new Changes(app);
