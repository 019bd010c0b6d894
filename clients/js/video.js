// Decodes H.264 through WebCodecs: a chain that starts at a keyframe, in which every other frame needs the previous one.
// Independent of connection and page; `world` provides decoder, timers and clock, also for tests.

import { FLAG_KEY } from './protocol.js';

const SILENT_S = 3; // a decoder without output for so long has failed

export function realWorld() {
  return {
    secure: globalThis.isSecureContext === true,
    VideoDecoder: globalThis.VideoDecoder,
    EncodedVideoChunk: globalThis.EncodedVideoChunk,
    setTimeout: (...args) => globalThis.setTimeout(...args),
    clearTimeout: (id) => globalThis.clearTimeout(id),
    nowMs: () => performance.now(),
  };
}

// Why H.264 is unavailable here, or null. A browser that claims support may still fail later.
export async function whyNoVideo(world = realWorld()) {
  if (!world.secure) return 'this page was not loaded over a secure connection';
  if (!world.VideoDecoder || !world.EncodedVideoChunk) return 'this browser has no WebCodecs';
  try {
    const { supported } = await world.VideoDecoder.isConfigSupported({ codec: 'avc1.42E01F', optimizeForLatency: true });
    return supported ? null : 'this browser does not decode H.264';
  } catch (error) {
    return `this browser reports no codec support: ${error.message}`;
  }
}

// The WebCodecs codec string of the stream that this keyframe starts, from its sequence parameter set: profile, constraints and
// level are the three bytes behind the NAL unit's header [H.264, 7.3.2.1.1]. null if there is none.
export function codecOf(payload) {
  for (let i = 0; i + 6 < payload.length; i++) {
    if (payload[i] !== 0 || payload[i + 1] !== 0 || payload[i + 2] !== 1 || (payload[i + 3] & 31) !== 7) continue;
    return `avc1.${[...payload.subarray(i + 4, i + 7)].map((byte) => byte.toString(16).padStart(2, '0')).join('').toUpperCase()}`;
  }
  return null;
}

export class Video {
  // on: {picture({header, bitmap, bytes, heardMs, decodeMs}), passed(header): will not be shown,
  //      lost(): a keyframe is needed, failed(reason): no more images will come}
  constructor(on, world = realWorld()) {
    this.on = on;
    this.world = world;
    this.pending = []; // in the decoder, oldest first
    this.decoder = null;
    this.codec = null;
    this.timer = undefined;
    this.closed = false;
  }

  take({ header, payload, heardMs }) {
    const key = (header.flags & FLAG_KEY) !== 0;
    if (this.closed || (!key && !this.decoder)) {
      this.on.passed(header);
      return;
    }
    try {
      if (key) this.begin(codecOf(payload));
      this.pending.push({ header, bytes: payload.byteLength, heardMs, begunMs: this.world.nowMs() });
      this.decoder.decode(new this.world.EncodedVideoChunk({
        type: key ? 'key' : 'delta',
        timestamp: header.sequence, // identifies the decoded frame
        data: payload,
      }));
      this.watch();
    } catch (error) {
      this.fail(error.message);
    }
  }

  // Releases the decoder and its contents: the next frame must be a keyframe.
  forget() {
    const { decoder } = this;
    this.decoder = null;
    this.codec = null;
    this.rest();
    for (const { header } of this.pending.splice(0)) this.on.passed(header);
    if (decoder && decoder.state !== 'closed') decoder.close();
  }

  close() {
    this.closed = true;
    this.forget();
  }

  begin(codec) {
    if (!codec) throw new Error('a keyframe has no parameter sets');
    if (this.decoder && codec === this.codec) return;
    this.forget();
    const decoder = new this.world.VideoDecoder({
      output: (frame) => {
        if (decoder === this.decoder) this.output(frame);
        else frame.close();
      },
      error: (error) => {
        if (decoder === this.decoder) this.broken(error);
      },
    });
    this.decoder = decoder;
    this.codec = codec;
    decoder.configure({ codec, optimizeForLatency: true });
  }

  output(frame) {
    const at = this.pending.findIndex(({ header }) => header.sequence === frame.timestamp);
    if (at < 0) {
      frame.close();
      return;
    }
    for (const { header } of this.pending.splice(0, at)) this.on.passed(header);
    const { header, bytes, heardMs, begunMs } = this.pending.shift();
    this.rest();
    this.watch();
    this.on.picture({ header, bitmap: frame, bytes, heardMs, decodeMs: this.world.nowMs() - begunMs });
  }

  // Browsers reclaim decoders that were idle for long; that is no failure.
  broken(error) {
    if (error.name === 'QuotaExceededError') {
      this.forget();
      this.on.lost();
    } else {
      this.fail(error.message);
    }
  }

  fail(reason) {
    this.close();
    this.on.failed(reason);
  }

  // While the decoder holds frames, three seconds without output are a failure. Counted second by second, since a computer that
  // slept sees them all pass at once.
  watch() {
    if (this.timer !== undefined || !this.pending.length || this.closed) return;
    let seconds = 0;
    const tick = () => {
      if (++seconds >= SILENT_S) this.fail(`the decoder produced nothing for ${SILENT_S} s`);
      else this.timer = this.world.setTimeout(tick, 1000);
    };
    this.timer = this.world.setTimeout(tick, 1000);
  }

  rest() {
    this.world.clearTimeout(this.timer);
    this.timer = undefined;
  }
}
