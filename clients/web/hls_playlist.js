// HLS media playlists [RFC 8216] and the codec of an initialisation segment: pure functions.

// A fault to show to the user.
export class HlsFault extends Error {}

// {variant: URL} for a playlist of playlists, else
// {target: seconds, ended, plain, map: URL or null, segments: [{sequence, url, map, seconds, date, broken}]}, oldest first.
// date: when the segment was recorded, in ms since 1970; NaN: not stated. broken: a discontinuity precedes it. plain: fragmented
// MP4 in whole files without encryption, which MediaSource takes as it is.
export function parsePlaylist(text, base) {
  const lines = text.split(/\r?\n/).map((line) => line.trim()).filter(Boolean);
  if (lines[0] !== '#EXTM3U') throw new HlsFault('is no HLS playlist');
  const list = { target: 0, ended: false, plain: true, map: null, segments: [] };
  let next = { seconds: 0, date: NaN, broken: false };
  let sequence = 0;
  let variant = false;
  for (const line of lines) {
    const [, tag, value] = line.match(/^#(EXT[^:]*):?(.*)$/) ?? [];
    if (!line.startsWith('#')) {
      if (variant) return { variant: new URL(line, base).href };
      list.segments.push({ sequence: sequence++, url: new URL(line, base).href, map: list.map, ...next });
      next = { seconds: 0, date: next.date + 1000 * next.seconds, broken: false };
    } else if (tag === 'EXT-X-TARGETDURATION') list.target = Math.max(0.1, Number(value) || 1);
    else if (tag === 'EXT-X-MEDIA-SEQUENCE') sequence = Number(value) || 0;
    else if (tag === 'EXTINF') next.seconds = Math.max(0, parseFloat(value) || 0);
    else if (tag === 'EXT-X-PROGRAM-DATE-TIME') next.date = Date.parse(value.replace(/([+-]\d\d)(\d\d)$/, '$1:$2'));
    else if (tag === 'EXT-X-STREAM-INF') variant = true;
    else if (tag === 'EXT-X-DISCONTINUITY') next.broken = true;
    else if (tag === 'EXT-X-ENDLIST') list.ended = true;
    else if (tag === 'EXT-X-MAP') list.map = new URL(value.match(/URI="([^"]*)"/)?.[1] ?? '', base).href;
    else if (tag === 'EXT-X-BYTERANGE' || (tag === 'EXT-X-KEY' && !/METHOD=NONE/.test(value))) list.plain = false;
  }
  if (!list.target) throw new HlsFault('is no HLS playlist');
  list.plain &&= list.segments.every(({ map }) => map);
  return list;
}

// The type for a SourceBuffer of an initialisation segment (Uint8Array): its avcC box states profile and level. null: not H.264.
export function typeOf(init) {
  for (let i = 4; i + 8 <= init.length; i++) {
    if (init[i] !== 0x61 || init[i + 1] !== 0x76 || init[i + 2] !== 0x63 || init[i + 3] !== 0x43) continue; // "avcC"
    const codec = [...init.subarray(i + 5, i + 8)].map((byte) => byte.toString(16).padStart(2, '0')).join('');
    return `video/mp4; codecs="avc1.${codec}"`;
  }
  return null;
}

// Whether bytes begin like a segment of fragmented MP4: a decoder waits for ever for the end of something else.
export function isFragment(bytes) {
  return ['styp', 'moof', 'sidx', 'emsg', 'prft'].includes(String.fromCharCode(...bytes.subarray(4, 8)));
}

// How long a playlist may stay the same before the stream counts as stalled, in seconds.
export const patience = (target) => Math.max(4, 3 * target);
