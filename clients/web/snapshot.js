// Saves the image as a file: the canvas as PNG, or the linear image as EXR, fetched over a second, short connection.

import { icon, make, saveAs, withKey } from './dom.js';
import { FLAG_REPEAT, PATH, PROTOCOL, VERSION, decodePicture } from './js/protocol.js';
import { wishedRole } from './role.js';

const PATIENCE_MS = 30000; // for that whole connection: a float image may be large and the line slow

// "relight_frame_118_2026-11-22T10-05-30Z.png": sky frame and time of publication.
export function fileName(header, extension) {
  const time = new Date(header.publishedUs / 1000).toISOString().slice(0, 19).replaceAll(':', '-');
  return `relight_frame_${header.frame}_${time}Z.${extension}`;
}

// The best linear format, or null.
export const numbersFormat = (offered) => ['exr_float', 'exr_half'].find((format) => offered?.includes(format)) ?? null;

// Fetches one image in that format. The server first sends the last one it encoded so, which may be old: a repeated image counts
// only if it shows the current frame.
export function fetchPicture({ url, role, token, frame, Socket = globalThis.WebSocket, patienceMs = PATIENCE_MS }) {
  return new Promise((resolve, reject) => {
    const socket = new Socket(url, PROTOCOL);
    let late;
    const end = (act, value) => {
      clearTimeout(late);
      socket.onmessage = socket.onclose = null;
      socket.close();
      act(value);
    };
    const say = (message) => socket.send(JSON.stringify(message));
    const hear = (message) => {
      if (message.op === 'error') end(reject, new Error(message.message));
      if (message.op !== 'welcome') return;
      const format = numbersFormat(message.formats);
      if (format) say({ op: 'subscribe', format });
      else end(reject, new Error('this server offers no EXR'));
    };
    late = setTimeout(() => end(reject, new Error('no image arrived')), patienceMs);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => say({ op: 'hello', role, version: VERSION, token });
    socket.onclose = ({ reason }) => end(reject, new Error(reason || 'the connection broke'));
    socket.onmessage = ({ data }) => {
      if (typeof data === 'string') {
        hear(JSON.parse(data));
        return;
      }
      const picture = decodePicture(data);
      if (!picture.ok) end(reject, new Error(picture.text));
      else if (picture.header.flags & FLAG_REPEAT && picture.header.frame !== frame) say({ op: 'ack', sequence: picture.header.sequence });
      else end(resolve, picture);
    };
  });
}

// Creates a button in the header: an icon, and a word that narrow windows hide.
export function topButton(id, label, word, path) {
  const button = make('button', { type: 'button', id, ariaLabel: label }, icon(path), make('span', { text: word }));
  document.getElementById('snapshot-place').append(button);
  return button;
}

export function mount(app) {
  const png = topButton('snapshot-png', 'Save the image as PNG', 'PNG', 'M2 4.5h3l1-1.5h4l1 1.5h3v8H2zM10.5 8.5a2.5 2.5 0 1 1-5 0 2.5 2.5 0 0 1 5 0');
  const exr = topButton('snapshot-exr', 'Save the linear image as EXR', 'EXR', 'M8 2v8M4.5 7 8 10.5 11.5 7M2.5 13.5h11');
  let shown = null; // the header of what the canvas shows

  async function savePng() {
    const name = fileName(shown, 'png');
    const blob = await new Promise((resolve) => app.canvas.toBlob(resolve, 'image/png'));
    saveAs(blob, name);
    app.say(`Saved ${name}`);
  }

  async function saveExr() {
    if (exr.disabled) return;
    exr.disabled = true;
    app.say('Requesting the linear image');
    try {
      const url = new URL(PATH, location.href.replace(/^http/, 'ws')).href;
      const { header, payload } = await fetchPicture({ url, role: app.role ?? 'viewer', token: wishedRole(location).token, frame: shown.frame });
      const name = fileName(header, 'exr');
      saveAs(new Blob([payload], { type: 'image/x-exr' }), name);
      app.say(`Saved ${name}`);
    } catch (error) {
      app.say(`No EXR: ${error.message}`);
    } finally {
      exr.disabled = false;
    }
  }

  app.on('picture', ({ header }) => { shown = header; });
  const ifShown = (save) => () => (shown ? save() : app.say('There is no image yet'));
  withKey(app, png, 's', 'Save the image as PNG', ifShown(savePng));
  withKey(app, exr, 'Shift+s', 'Save the linear image as EXR', ifShown(saveExr));
}
