// relight.v1 (protocol/PROTOCOL.md): binary headers and close codes. Pure functions.

export const PROTOCOL = 'relight.v1';
export const VERSION = { major: 1, minor: 2 };
export const PATH = '/ws';
export const CREDIT = 2;

export const PICTURE_BYTES = 80;
export const ENVIRONMENT_BYTES = 48;
const HEADER_MAX = 1024;
const SIDE_MAX = 16384;

export const FORMATS = { 1: 'jpeg', 2: 'exr_half', 3: 'exr_float', 4: 'h264' };
export const ENCODINGS = { 1: 'file_exr', 2: 'file_hdr', 3: 'raw_half', 4: 'raw_float' };
export const LAYOUTS = ['auto', 'latlong', 'cube', 'hcross', 'vcross', 'ball', 'fisheye'];

export const FLAG_LAST = 1;
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

function fault(result, section) {
  const [clause, text] = RESULTS[result];
  return { ok: false, result, clause: `${section}.${clause}`, text };
}

// A DataView over an ArrayBuffer or a typed array.
function viewOf(bytes) {
  return bytes instanceof ArrayBuffer
    ? new DataView(bytes)
    : new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
}

// 64-bit numbers on the wire are below 2^53; others become NaN.
function number64(value) {
  const n = Number(value);
  return Number.isSafeInteger(n) ? n : NaN;
}

// The fault in the common start of both headers, or null.
function beginFault(view, magic, least) {
  if (view.byteLength >= 4 && view.getUint32(0, true) !== magic) return 'magic';
  if (view.byteLength < least) return 'short';
  const header = view.getUint16(4, true);
  if (header < least || header > HEADER_MAX || header % 4 !== 0) return 'header';
  return null;
}

const MAGIC_PICTURE = 0x31504c52; // "RLP1"
const MAGIC_ENVIRONMENT = 0x31454c52; // "RLE1"

const sideOk = (n) => n >= 1 && n <= SIDE_MAX;

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

const keyOf = (table, word) => Number(Object.keys(table).find((key) => table[key] === word));

// Encodes the 80 bytes of a picture header.
export function encodePicture(header) {
  const bytes = new Uint8Array(PICTURE_BYTES);
  const view = new DataView(bytes.buffer);
  view.setUint32(0, MAGIC_PICTURE, true);
  view.setUint16(4, PICTURE_BYTES, true);
  view.setUint8(6, keyOf(FORMATS, header.format));
  view.setUint8(7, header.flags);
  view.setBigUint64(8, BigInt(header.sequence), true);
  view.setBigUint64(16, BigInt(header.frame), true);
  view.setBigInt64(24, BigInt(header.captureUs), true);
  view.setBigInt64(32, BigInt(header.publishedUs), true);
  view.setUint32(40, header.queuedUs, true);
  view.setUint32(44, header.decodedUs, true);
  view.setUint32(48, header.shadedUs, true);
  view.setUint32(52, header.encodedUs, true);
  view.setUint32(56, header.width, true);
  view.setUint32(60, header.height, true);
  view.setFloat32(64, header.gain, true);
  view.setUint32(68, header.samples, true);
  view.setUint32(72, header.payload, true);
  return bytes;
}

function environmentSizeOk(header) {
  if (header.encoding.startsWith('file')) return !header.width && !header.height && !header.channels;
  if (!sideOk(header.width) || !sideOk(header.height) || header.channels < 3 || header.channels > 4) return false;
  return header.width * header.height * header.channels * (header.encoding === 'raw_half' ? 2 : 4) === header.payload;
}

// A whole environment frame; result as in decodePicture.
export function decodeEnvironment(bytes) {
  const view = viewOf(bytes);
  const wrong = beginFault(view, MAGIC_ENVIRONMENT, ENVIRONMENT_BYTES);
  if (wrong) return fault(wrong, 7);
  const length = view.getUint16(4, true);
  const header = {
    encoding: ENCODINGS[view.getUint8(6)],
    layout: LAYOUTS[view.getUint8(7)],
    flags: view.getUint8(8),
    channels: view.getUint8(9),
    width: view.getUint32(12, true),
    height: view.getUint32(16, true),
    payload: view.getUint32(20, true),
    frame: number64(view.getBigUint64(24, true)),
    captureUs: number64(view.getBigInt64(32, true)),
  };
  if (view.byteLength < length || view.byteLength - length !== header.payload || header.payload === 0)
    return fault('length', 7);
  if (!header.encoding || !header.layout) return fault('format', 7);
  if (!environmentSizeOk(header)) return fault('size', 7);
  if (Number.isNaN(header.frame) || Number.isNaN(header.captureUs)) return fault('value', 7);
  return { ok: true, header, payload: new Uint8Array(view.buffer, view.byteOffset + length, header.payload) };
}

export function encodeEnvironment(header) {
  const bytes = new Uint8Array(ENVIRONMENT_BYTES);
  const view = new DataView(bytes.buffer);
  view.setUint32(0, MAGIC_ENVIRONMENT, true);
  view.setUint16(4, ENVIRONMENT_BYTES, true);
  view.setUint8(6, keyOf(ENCODINGS, header.encoding));
  view.setUint8(7, LAYOUTS.indexOf(header.layout));
  view.setUint8(8, header.flags);
  view.setUint8(9, header.channels);
  view.setUint32(12, header.width, true);
  view.setUint32(16, header.height, true);
  view.setUint32(20, header.payload, true);
  view.setBigUint64(24, BigInt(header.frame), true);
  view.setBigInt64(32, BigInt(header.captureUs), true);
  return bytes;
}

// PROTOCOL.md section 8: a viewer's policy and message for each close code.
const CLOSES = {
  1000: ['again', 'The server closed the connection.'],
  1001: ['again', 'The server has stopped.'],
  1002: ['never', 'The server reported a malformed connection.'],
  1006: ['again', 'The connection broke.'],
  1007: ['never', 'The server received text that is not UTF-8.'],
  1009: ['never', 'The server received a message that is too large.'],
  4001: ['never', 'The server could not parse a message from this page.'],
  4002: ['never', 'The server found an invalid value in a message from this page.'],
  4003: ['never', 'The server did not expect a message from this page.'],
  4004: ['never', 'The server does not offer this role.'],
  4005: ['never', 'The server speaks another version of the protocol. Reloading the page may help.'],
  4006: ['never', 'The server requires a token: add #role=viewer&token=… to the address.'],
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
