// relight.v1 (protocol/PROTOCOL.md): picture headers and close codes. Pure functions.

export const PROTOCOL = 'relight.v1';
export const VERSION = { major: 1, minor: 2 };
export const PATH = 'ws'; // relative: a proxy may serve relightd below a path
export const CREDIT = 2;

export const PICTURE_BYTES = 80;
const HEADER_MAX = 1024;
const SIDE_MAX = 16384;

export const FORMATS = { 1: 'jpeg', 2: 'exr_half', 3: 'exr_float', 4: 'h264', 5: 'changes' };

export const FLAG_REPEAT = 2;
export const FLAG_FINER = 32; // a refinement of the frame shown before
export const FLAG_KEY = 64; // H.264 keyframe: needs no earlier frame

const RESULTS = {
  short: ['1', 'the message ends inside its header'],
  magic: ['1', "the message does not begin with the header's magic bytes"],
  header: ['2', "the header's own length is not allowed"],
  length: ['3', 'header and payload do not add up to the message'],
  format: ['4', 'the format, encoding or layout is unknown'],
  size: ['5', 'width, height or channels are out of range or do not match the payload'],
  value: ['6', 'a number is out of its range'],
};

export function fault(result, section) {
  const [clause, text] = RESULTS[result];
  return { ok: false, result, clause: `${section}.${clause}`, text };
}

// A DataView over an ArrayBuffer or a typed array.
export function viewOf(bytes) {
  return bytes instanceof ArrayBuffer
    ? new DataView(bytes)
    : new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
}

// 64-bit numbers on the wire are below 2^53; others become NaN.
export function number64(value) {
  const n = Number(value);
  return Number.isSafeInteger(n) ? n : NaN;
}

// The fault in the start that pictures and environment frames have in common, or null.
export function beginFault(view, magic, least) {
  if (view.byteLength >= 4 && view.getUint32(0, true) !== magic) return 'magic';
  if (view.byteLength < least) return 'short';
  const header = view.getUint16(4, true);
  if (header < least || header > HEADER_MAX || header % 4 !== 0) return 'header';
  return null;
}

export const MAGIC_PICTURE = 0x31504c52; // "RLP1"

export const sideOk = (n) => n >= 1 && n <= SIDE_MAX;

// A whole message: {ok: true, header, payload: Uint8Array over the same memory} or {ok: false, result, clause, text, sequence};
// sequence, by which a picture can be acknowledged and skipped, is undefined if it cannot be read.
export function decodePicture(bytes) {
  const view = viewOf(bytes);
  const wrong = beginFault(view, MAGIC_PICTURE, PICTURE_BYTES);
  if (wrong) return fault(wrong, 6);
  const picture = readPicture(view);
  return picture.ok ? picture : { ...picture, sequence: number64(view.getBigUint64(8, true)) || undefined };
}

function readPicture(view) {
  const length = view.getUint16(4, true);
  const header = {
    format: FORMATS[view.getUint8(6)],
    flags: view.getUint8(7),
    sequence: number64(view.getBigUint64(8, true)),
    frame: number64(view.getBigUint64(16, true)),
    captureUs: number64(view.getBigInt64(24, true)),
    publishedUs: number64(view.getBigInt64(32, true)),
    queuedUs: view.getUint32(40, true),
    decodedUs: view.getUint32(44, true),
    shadedUs: view.getUint32(48, true),
    encodedUs: view.getUint32(52, true),
    width: view.getUint32(56, true),
    height: view.getUint32(60, true),
    gain: view.getFloat32(64, true),
    samples: view.getUint32(68, true),
    payload: view.getUint32(72, true),
  };
  if (view.byteLength < length || view.byteLength - length !== header.payload || header.payload === 0)
    return fault('length', 6);
  if (!header.format) return fault('format', 6);
  if (!sideOk(header.width) || !sideOk(header.height)) return fault('size', 6);
  const numbers = [header.sequence, header.frame, header.captureUs, header.publishedUs];
  if (numbers.some(Number.isNaN) || header.sequence === 0 || !Number.isFinite(header.gain) || header.gain < 0)
    return fault('value', 6);
  return { ok: true, header, payload: new Uint8Array(view.buffer, view.byteOffset + length, header.payload) };
}

// PROTOCOL.md section 8: a viewer's policy and message for each close code.
const CLOSES = {
  1000: ['again', 'The server closed the connection.'],
  1001: ['again', 'The server has stopped.'],
  1002: ['never', 'The server reported a malformed connection.'],
  1006: ['again', 'The connection broke.'],
  1007: ['never', 'The server received text that is not UTF-8.'],
  1009: ['never', 'The server received a message that is too large.'],
  4001: ['never', 'The server could not parse a message from this viewer.'],
  4002: ['never', 'The server found an invalid value in a message from this viewer.'],
  4003: ['never', 'The server did not expect a message from this viewer.'],
  4004: ['never', 'The server does not offer this role.'],
  4005: ['never', 'The server speaks another version of the protocol. Reloading the page may help.'],
  4006: ['never', 'The server requires a token.'],
  4007: ['later', 'The server has reached its connection limit.'],
  4008: ['again', 'This page did not answer the server in time.'],
  4009: ['again', 'The connection was too slow for the server.'],
  4010: ['later', 'This page sent too many requests.'],
  4011: ['never', 'Another client has taken this one\u2019s place.'],
  4012: ['later', 'Another producer is active.'],
  4013: ['again', 'A frame took too long to arrive.'],
  4014: ['never', 'A frame was sent without credit.'],
};

// {policy: 'again' | 'later' | 'never', text}: retry with back-off, after ten seconds, or only when the user asks.
export function closePolicy(code) {
  const [policy, text] = CLOSES[code] ?? (code >= 4000
    ? ['never', `The server refused the connection (code ${code}).`]
    : ['again', `The connection ended (code ${code}).`]);
  return { policy, text };
}
