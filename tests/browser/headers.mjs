// The headers that the page neither reads nor writes: those of environment frames, and pictures for tests to send.

import {
  FORMATS, MAGIC_PICTURE, PICTURE_BYTES, beginFault, fault, number64, sideOk, viewOf,
} from '../../clients/js/protocol.js';

const ENVIRONMENT_BYTES = 48;
const MAGIC_ENVIRONMENT = 0x31454c52; // "RLE1"
const ENCODINGS = { 1: 'file_exr', 2: 'file_hdr', 3: 'raw_half', 4: 'raw_float' };
const LAYOUTS = ['auto', 'latlong', 'cube', 'hcross', 'vcross', 'ball', 'fisheye'];

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
