// Types of relight.js. Messages are those of protocol/PROTOCOL.md; what a server may add is allowed by index signatures.

export const PROTOCOL: 'relight.v1';
export const VERSION: { major: number; minor: number };
export const PATH: string;
export const CREDIT: number;
export const PICTURE_BYTES: number;
export const FORMATS: Record<number, Format>;
export const FLAG_REPEAT: number;
export const FLAG_FINER: number;
export const FLAG_KEY: number;
export const MAGIC_PICTURE: number;

export type Format = 'jpeg' | 'h264' | 'exr_half' | 'exr_float' | 'changes';
export type Role = 'viewer' | 'controller';

/** PROTOCOL.md section 6. Times are microseconds since 1970 by the server's clock, durations microseconds. */
export interface PictureHeader {
  format: Format;
  flags: number;
  sequence: number;
  frame: number;
  captureUs: number;
  publishedUs: number;
  queuedUs: number;
  decodedUs: number;
  shadedUs: number;
  encodedUs: number;
  width: number;
  height: number;
  gain: number;
  samples: number;
  payload: number;
}

/** With decode: `bitmap`, which the receiver closes. Without: `payload`, the encoded file. */
export interface Picture {
  header: PictureHeader;
  bitmap?: VideoFrame | ImageBitmap;
  payload?: Uint8Array;
}

export interface Message { op: string; [field: string]: unknown }
export interface Settings { [name: string]: unknown }

/** connecting, live, waiting, paused, ended, stalled, failed, reconnecting or refused; only the last is final. */
export interface State { name: string; detail?: string; [field: string]: unknown }

export interface Handlers {
  picture?(picture: Picture): void;
  status?(status: Message): void;
  state?(state: State): void;
  settings?(settings: Message): void;
  heard?(message: Message): void;
  error?(error: RelightError): void;
}

export interface Options {
  role?: Role;
  token?: string;
  coding?: Format;
  decode?: boolean;
  quality?: number;
  maxRate?: number;
  maxWidth?: number;
  on?: Handlers;
  WebSocket?: unknown;
}

export class RelightError extends Error {
  code?: string;
  clause?: string;
}

export class Relight {
  constructor(address: string, options?: Options);
  readonly welcome?: Message;
  readonly status?: Message;
  readonly settings?: Message;
  readonly state: State;
  readonly role?: Role;
  connected(): Promise<Message>;
  picture(): Promise<Picture>;
  pictures(): AsyncGenerator<Picture, never>;
  control(settings: Settings): Promise<Message>;
  probe(pixel: { x: number; y: number; samples?: number; sky?: boolean; follow?: boolean }): Promise<Message>;
  stop(): void;
}

export function address(text: string): { url: string; token?: string };

export type Decoded =
  | { ok: true; header: PictureHeader; payload: Uint8Array }
  | { ok: false; result: string; clause: string; text: string; sequence?: number };

export function decodePicture(bytes: ArrayBuffer | Uint8Array): Decoded;
export function closePolicy(code: number): { policy: 'again' | 'later' | 'never'; text: string };
export function fault(result: string, section: number): { ok: false; result: string; clause: string; text: string };
export function viewOf(bytes: ArrayBuffer | Uint8Array): DataView;
export function number64(value: bigint): number;
export function beginFault(view: DataView, magic: number, least: number): string | null;
export function sideOk(n: number): boolean;

/** What Relight is built on, also usable by itself: see the comments in connection.js, player.js and video.js. */
export class Connection {
  constructor(url: string, on: Record<string, (...values: any[]) => void>, world?: unknown);
  start(): void;
  stop(): void;
  [field: string]: any;
}
export class Player {
  constructor(emit: (event: Message, transfer?: unknown[]) => void, world?: unknown);
  command(message: Message): void;
}
export class Video {
  constructor(on: Record<string, (...values: any[]) => void>, world?: unknown);
  take(picture: { header: PictureHeader; payload: Uint8Array; heardMs: number }): void;
  forget(): void;
  close(): void;
}
export function codecOf(payload: Uint8Array): string | null;
export function whyNoVideo(world?: unknown): Promise<string | null>;
