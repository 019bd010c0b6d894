// The timeline below the image: play and pause, one frame forward or back, and a slider for the sequence or the day.

import { hourText, stepWish, transportOf, wrapHour } from './controls_model.js';
import { dayText } from './daylight_model.js';
import { icon, make, setValue } from './dom.js';

const ICONS = {
  play: 'M4 2.5v11l9-5.5z',
  pause: 'M3.5 2.5h3.2v11H3.5zM9.3 2.5h3.2v11H9.3z',
  back: 'M12.5 2.5v11L5 8zM3 2.5h1.8v11H3z',
  on: 'M3.5 2.5v11L11 8zM11.2 2.5H13v11h-1.8z',
};

export class Transport {
  constructor(controls) {
    this.controls = controls;
    this.bar = document.getElementById('transport');
    this.back = this.button('step-back', 'back', 'One frame back', 'ArrowLeft', () => this.step(-1));
    this.play = this.button('play', 'pause', 'Pause', 'Space', () => this.toggle());
    this.on = this.button('step-on', 'on', 'One frame forward', 'ArrowRight', () => this.step(1));
    this.scale = make('input', { type: 'range', id: 'scrub', ariaLabel: 'Position in time' });
    this.scale.oninput = () => this.scrub(Number(this.scale.value));
    this.days = make('input', { type: 'range', id: 'scrub-day', min: 1, max: 365, step: 1, ariaLabel: 'Day of the year' });
    this.days.oninput = () => controls.ask({ day: Number(this.days.value) });
    this.text = make('output', { id: 'scrub-text', htmlFor: 'scrub' });
    this.bar.append(this.back, this.play, this.on, this.days, this.scale, this.text);
    const { app } = controls;
    app.key(' ', 'Pause or resume the sky', () => this.toggle());
    app.key(['ArrowLeft', ','], 'One frame back, paused', () => this.step(-1));
    app.key(['ArrowRight', '.'], 'One frame forward, paused', () => this.step(1));
    app.key('Shift+ArrowLeft', 'Ten frames or one hour back', () => this.step(-1, true));
    app.key('Shift+ArrowRight', 'Ten frames or one hour forward', () => this.step(1, true));
  }

  button(id, name, label, keys, act) {
    const attributes = { 'aria-label': label, 'aria-keyshortcuts': keys };
    const button = make('button', { type: 'button', id, title: label, attributes }, icon(ICONS[name], 'solid'));
    button.onclick = act;
    return button;
  }

  toggle() {
    const { controls } = this;
    if (!transportOf(controls.app.status).play && controls.may) return;
    const paused = !controls.now.paused;
    controls.askAndSay({ paused }, () => (paused ? 'Paused' : 'Running'));
  }

  step(by, leap = false) {
    const { controls } = this;
    const can = transportOf(controls.app.status);
    if (!can.step && controls.may) return;
    // The newest requested hour counts, even before the server answers.
    const hour = controls.now.hour ?? controls.app.status?.source?.hour;
    const source = { ...controls.app.status?.source, hour };
    controls.askAndSay(stepWish({ source }, by, leap),
      () => (leap && controls.now.hour !== undefined ? hourText(controls.now.hour) : by < 0 ? 'Back' : 'Forward'));
  }

  scrub(value) {
    const { controls } = this;
    const hours = typeof controls.app.status?.source?.hour === 'number';
    controls.ask(hours ? { hour: Math.min(wrapHour(value) || 0, 23.99) } : { seek: value });
  }

  show() {
    const { app, may, now } = this.controls;
    const can = transportOf(app.status);
    this.bar.hidden = app.control === null || (!can.play && !can.text);
    for (const button of [this.back, this.on]) {
      button.hidden = !can.step;
      button.disabled = !may;
    }
    this.play.hidden = !can.play;
    this.play.disabled = !may;
    this.showPlay(Boolean(now.paused));
    this.days.hidden = !can.day;
    this.days.disabled = !may;
    if (can.day) {
      setValue(this.days, now.day ?? can.day);
      this.days.setAttribute('aria-valuetext', dayText(Number(this.days.value)));
    }
    this.scale.hidden = !can.scrub;
    this.scale.disabled = !may;
    this.text.textContent = can.text;
    if (!can.scrub) return;
    const { least, most, step, value } = can.scrub;
    Object.assign(this.scale, { min: least, max: most, step });
    const wished = now.hour ?? now.seek ?? value;
    setValue(this.scale, wished);
    this.scale.setAttribute('aria-valuetext', can.text);
  }

  showPlay(paused) {
    const label = paused ? 'Resume the sky' : 'Pause the sky';
    if (this.play.title === label) return;
    this.play.title = label;
    this.play.setAttribute('aria-label', label);
    this.play.replaceChildren(icon(ICONS[paused ? 'play' : 'pause'], 'solid'));
  }
}
