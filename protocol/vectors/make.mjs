// Writes the golden vectors, field by field from the tables of PROTOCOL.md; shares no code with the codecs under test.
import { writeFileSync } from 'node:fs';

const here = new URL('.', import.meta.url);

// [type, value] pairs one after another, little-endian.
function bytesOf(fields) {
  return Buffer.concat(fields.map(([type, value]) => {
    if (type === 'bytes') return Buffer.from(value);
    const buffer = Buffer.alloc({ u8: 1, u16: 2, u32: 4, f32: 4, u64: 8, i64: 8 }[type]);
    ({
      u8: () => buffer.writeUInt8(value), u16: () => buffer.writeUInt16LE(value), u32: () => buffer.writeUInt32LE(value),
      f32: () => buffer.writeFloatLE(value), u64: () => buffer.writeBigUInt64LE(BigInt(value)),
      i64: () => buffer.writeBigInt64LE(BigInt(value)),
    })[type]();
    return buffer;
  }));
}

const formats = { jpeg: 1, exr_half: 2, exr_float: 3, h264: 4, changes: 5 };
const encodings = { file_exr: 1, file_hdr: 2, raw_half: 3, raw_float: 4 };
const layouts = ['auto', 'latlong', 'cube', 'hcross', 'vcross', 'ball', 'fisheye', 'cube-3x2', 'cube-6x1'];

function picture(h, payload, { magic = 'RLP1', length = 80, extra = [] } = {}) {
  return Buffer.concat([bytesOf([
    ['bytes', magic], ['u16', length], ['u8', formats[h.format] ?? h.format], ['u8', h.flags], ['u64', h.sequence],
    ['u64', h.frame], ['i64', h.captureUs], ['i64', h.publishedUs], ['u32', h.queuedUs], ['u32', h.decodedUs],
    ['u32', h.shadedUs], ['u32', h.encodedUs], ['u32', h.width], ['u32', h.height], ['f32', h.gain], ['u32', h.samples],
    ['u32', h.payload], ['u32', 0], ['bytes', extra],
  ]), Buffer.from(payload)]);
}

function environment(h, payload, { magic = 'RLE1', length = 48, extra = [], zeros = [0, 0] } = {}) {
  return Buffer.concat([bytesOf([
    ['bytes', magic], ['u16', length], ['u8', encodings[h.encoding] ?? h.encoding],
    ['u8', typeof h.layout === 'string' ? layouts.indexOf(h.layout) : h.layout], ['u8', h.flags], ['u8', h.channels],
    ['u16', zeros[0]], ['u32', h.width], ['u32', h.height], ['u32', h.payload], ['u64', h.frame], ['i64', h.captureUs],
    ['u64', zeros[1]], ['bytes', extra],
  ]), Buffer.from(payload)]);
}

function write(name, about, kind, bytes, rest) {
  writeFileSync(new URL(`${name}.bin`, here), bytes);
  writeFileSync(new URL(`${name}.json`, here), `${JSON.stringify({ about, kind, bytes: bytes.length, ...rest }, null, 2)}\n`);
}

const hex = (payload) => Buffer.from(payload).toString('hex');
const jpeg = [0xff, 0xd8, 0xff, 0xd9];
const plain = {
  format: 'jpeg', flags: 0, sequence: 1, frame: 0, captureUs: 0, publishedUs: 1700000000000000, queuedUs: 0, decodedUs: 0,
  shadedUs: 0, encodedUs: 0, width: 1, height: 1, gain: 1, samples: 0, payload: 4,
};
const full = {
  format: 'exr_float', flags: 3, sequence: 9007199254740991, frame: 9007199254740990, captureUs: -9007199254740991,
  publishedUs: 9007199254740991, queuedUs: 1, decodedUs: 16909060, shadedUs: 4294967295, encodedUs: 4, width: 16384,
  height: 16383, gain: 0.15625, samples: 4096, payload: 7,
};

// Bytes that today's writers do not write.
const unknown = (options) => (options ? { unknown: true } : {});
const good = (name, about, header, payload, options) =>
  write(name, about, 'picture', picture(header, payload, options), { header, payload_hex: hex(payload), ...unknown(options) });
const bad = (name, about, header, payload, fails, options) =>
  write(name, about, 'picture', picture(header, payload, options), { fails });

good('picture_least', 'the smallest picture', plain, jpeg);
good('picture_full', 'every field different and at an edge', full, [1, 2, 3, 4, 5, 6, 7]);
good('picture_changes', 'a change map', { ...plain, format: 'changes', payload: 5 }, [0x89, 0x50, 0x4e, 0x47, 0x0d]);
good('picture_h264', 'a key picture of H.264', { ...plain, format: 'h264', flags: 64, payload: 5 }, [0, 0, 0, 1, 0x67]);
good('picture_longer_header', 'a later minor version: 8 more bytes of header, and a flag nobody knows yet',
  { ...plain, flags: 128 }, jpeg, { length: 88, extra: [9, 9, 9, 9, 9, 9, 9, 9] });
bad('picture_magic', 'other magic bytes', plain, jpeg, '6.1', { magic: 'RLP2' });
bad('picture_header_short', 'a header length of 76', plain, jpeg, '6.2', { length: 76 });
bad('picture_header_odd', 'a header length of 82', plain, jpeg, '6.2', { length: 82, extra: [0, 0] });
bad('picture_header_beyond', 'a header that ends behind the message', plain, jpeg, '6.3', { length: 1024 });
bad('picture_payload_lies', 'a payload length of 2^32 - 1', { ...plain, payload: 4294967295 }, jpeg, '6.3');
bad('picture_payload_none', 'no payload', { ...plain, payload: 0 }, [], '6.3');
bad('picture_payload_over', 'one byte too many', plain, [...jpeg, 0], '6.3');
bad('picture_format', 'format 6', { ...plain, format: 6 }, jpeg, '6.4');
bad('picture_width', 'a width of 0', { ...plain, width: 0 }, jpeg, '6.5');
bad('picture_height', 'a height of 16385', { ...plain, height: 16385 }, jpeg, '6.5');
bad('picture_sequence_none', 'sequence 0', { ...plain, sequence: 0 }, jpeg, '6.6');
bad('picture_frame_large', 'a frame number of 2^53', { ...plain, frame: 2n ** 53n }, jpeg, '6.6');
bad('picture_time_large', 'a capture time of -2^53', { ...plain, captureUs: -(2n ** 53n) }, jpeg, '6.6');
bad('picture_gain_nan', 'a gain that is not a number', { ...plain, gain: NaN }, jpeg, '6.6');
bad('picture_gain_negative', 'a negative gain', { ...plain, gain: -1 }, jpeg, '6.6');

const file = {
  encoding: 'file_exr', layout: 'auto', flags: 0, channels: 0, width: 0, height: 0, payload: 4, frame: 12,
  captureUs: 1700000000000000,
};
const raw = { ...file, encoding: 'raw_half', layout: 'latlong', flags: 1, channels: 3, width: 2, height: 1, payload: 12 };
const texels = [0, 0x3c, 0, 0x40, 0, 0x42, 0xff, 0x7b, 0, 0, 1, 0];

const goodEnvironment = (name, about, header, payload, options) =>
  write(name, about, 'environment', environment(header, payload, options), { header, payload_hex: hex(payload), ...unknown(options) });
const badEnvironment = (name, about, header, payload, fails, options) =>
  write(name, about, 'environment', environment(header, payload, options), { fails });

goodEnvironment('environment_file', 'the first bytes of an EXR file', file, [0x76, 0x2f, 0x31, 0x01]);
goodEnvironment('environment_raw', 'two half-float texels, bottom row first', raw, texels);
goodEnvironment('environment_float', 'one float texel with alpha, on a fisheye, frame and time at their edges',
  { ...raw, encoding: 'raw_float', layout: 'fisheye', flags: 0, channels: 4, width: 1, payload: 16, frame: 9007199254740991,
    captureUs: -9007199254740991 }, [...texels, 0, 0, 0, 0]);
goodEnvironment('environment_longer_header', 'a later minor version', { ...file, encoding: 'file_hdr' }, [35, 63, 82, 65],
  { length: 52, extra: [1, 2, 3, 4] });
goodEnvironment('environment_reserved', 'a later minor version: flags that nobody knows yet, and values in fields that are 0 today',
  { ...raw, flags: 254 }, texels, { zeros: [65535, 2n ** 64n - 1n] });
badEnvironment('environment_magic', 'the magic of a picture', file, jpeg, '7.1', { magic: 'RLP1' });
badEnvironment('environment_header', 'a header length of 1028', file, jpeg, '7.2', { length: 1028 });
badEnvironment('environment_payload', 'a payload length one too large', { ...file, payload: 5 }, jpeg, '7.3');
badEnvironment('environment_encoding', 'encoding 0', { ...file, encoding: 0 }, jpeg, '7.4');
badEnvironment('environment_layout', 'layout 9', { ...file, layout: 9 }, jpeg, '7.4');
badEnvironment('environment_size', 'raw texels that do not fill the payload', { ...raw, height: 2 }, texels, '7.5');
badEnvironment('environment_wraps', 'raw texels whose size wraps around at 32 bits', { ...raw, encoding: 'raw_float', channels: 4,
  width: 16384, height: 16384, payload: 12 }, texels, '7.5');
badEnvironment('environment_channels', 'raw with 2 channels', { ...raw, channels: 2, width: 3 }, texels, '7.5');
badEnvironment('environment_file_size', 'a file that is given a width', { ...file, width: 4 }, jpeg, '7.5');
badEnvironment('environment_frame', 'a frame number of 2^64 - 1', { ...file, frame: 2n ** 64n - 1n }, jpeg, '7.6');
