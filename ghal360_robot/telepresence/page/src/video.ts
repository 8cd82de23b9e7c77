/** The robot's pictures: from the socket through WebCodecs to the newest one that can be drawn. */

import { Planes } from "./planes.ts";

const HEADER_BYTES = 24;
const KEY = 1;
const GAP = 2;
const JPEG = 8;
/** Of a group that had begun before this connection. */
const BEHIND = 16;
/** A decoder with more waiting has fallen behind; it would only get later. */
const MAX_QUEUE = 3;
const RATE_MS = 2000;
const AGAIN_MS = 1000;

export interface Picture {
  image: VideoFrame | ImageBitmap | Planes;
  sequence: number;
  captureUs: number;
  width: number;
  height: number;
}

type About = Omit<Picture, "image" | "sequence">;

export type StreamName = "camera" | "small" | "stills";

export const canDecode = "VideoDecoder" in globalThis;

export class Video {
  dropped = 0;
  /** Since the socket opened, nothing could be shown yet. */
  waiting = true;
  error = "";
  /** Called for every decoded picture with its capture's instant. */
  onDecoded: (captureUs: number) => void = () => undefined;
  private socket: WebSocket | undefined;
  private decoder: VideoDecoder | undefined;
  private codec = "";
  private needKey = true;
  /** What waits for the decoder came all at once, as it was meant to. */
  private catchingUp = false;
  /** Whether this browser lets go of its frames' planes, as far as is known. */
  private unpacks = true;
  private newest: Picture | undefined;
  private readonly captures = new Map<number, { captureUs: number; width: number; height: number }>();
  private readonly decodedMs: number[] = [];
  private address = "";

  /** Get this stream from now on. */
  open(conn: string, stream: StreamName): void {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.address = `${scheme}://${location.host}/video?conn=${encodeURIComponent(conn)}&stream=${stream}`;
    this.dial();
  }

  close(): void {
    this.address = "";
    const socket = this.socket;
    this.socket = undefined;
    socket?.close();
    this.reset();
  }

  /** The newest picture, once; whoever takes it has to close it. */
  take(): Picture | undefined {
    const picture = this.newest;
    this.newest = undefined;
    return picture;
  }

  /** Pictures decoded a second, over the last two. */
  get rate(): number {
    const now = performance.now();
    while (this.decodedMs.length > 0 && now - this.decodedMs[0]! > RATE_MS) this.decodedMs.shift();
    return (this.decodedMs.length * 1000) / RATE_MS;
  }

  private dial(): void {
    const address = this.address;
    this.socket?.close();
    this.reset();
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onmessage = (event) => this.arrived(event.data as ArrayBuffer);
    socket.onclose = () => {
      if (this.socket !== socket) return;
      this.waiting = true;
      setTimeout(() => {
        if (this.socket === socket && this.address === address) this.dial();
      }, AGAIN_MS);
    };
  }

  private reset(): void {
    this.newest?.image.close();
    this.newest = undefined;
    this.needKey = true;
    this.waiting = true;
    this.catchingUp = false;
    this.captures.clear();
    if (this.decoder !== undefined && this.decoder.state !== "closed") this.decoder.close();
    this.decoder = undefined;
    this.codec = "";
  }

  private arrived(message: ArrayBuffer): void {
    const view = new DataView(message);
    const flags = view.getUint8(1);
    const sequence = view.getUint32(4, true);
    const about = {
      captureUs: Number(view.getBigUint64(8, true)),
      width: view.getUint16(16, true),
      height: view.getUint16(18, true),
    };
    const data = new Uint8Array(message, HEADER_BYTES);
    if (flags & JPEG) void this.still(data, sequence, about);
    else this.unit(data, flags, sequence, about);
  }

  private unit(data: Uint8Array<ArrayBuffer>, flags: number, sequence: number, about: About): void {
    const key = (flags & KEY) !== 0;
    const full = (this.decoder?.decodeQueueSize ?? 0) > MAX_QUEUE;
    this.catchingUp = (flags & BEHIND) !== 0 || (this.catchingUp && full && !key);
    const late = full && !this.catchingUp;
    if (!key && (this.needKey || (flags & GAP) !== 0 || late)) {
      this.needKey = true;
      this.dropped += 1;
      return;
    }
    if (key && !this.configured(data, late)) {
      this.dropped += 1;
      return;
    }
    this.needKey = false;
    this.captures.set(sequence, about);
    if (this.captures.size > 64) this.captures.delete(this.captures.keys().next().value!);
    this.decoder!.decode(new EncodedVideoChunk({ type: key ? "key" : "delta", timestamp: sequence, data }));
  }

  /** A decoder that is ready for this key picture; one that is behind starts afresh. */
  private configured(data: Uint8Array, late: boolean): boolean {
    const codec = codecOf(data);
    if (codec === undefined) return false;
    const old = this.decoder;
    if (old !== undefined && old.state === "configured" && codec === this.codec && !late) return true;
    if (old !== undefined && old.state !== "closed") {
      this.dropped += old.decodeQueueSize;
      old.close();
    }
    const decoder = new VideoDecoder({
      output: (frame) => this.decoded(frame),
      error: (error) => {
        this.error = error.message;
        this.needKey = true;
      },
    });
    // Without optimizeForLatency one picture more is held back.
    decoder.configure({ codec, optimizeForLatency: true });
    this.decoder = decoder;
    this.codec = codec;
    return true;
  }

  private decoded(frame: VideoFrame): void {
    const sequence = frame.timestamp;
    const about = this.captures.get(sequence);
    if (about === undefined) {
      frame.close();
      return;
    }
    this.captures.delete(sequence);
    this.onDecoded(about.captureUs);
    if (this.unpacks && Planes.fit(frame)) void this.unpack(frame, sequence, about);
    else this.show({ image: frame, sequence, ...about });
  }

  private async unpack(frame: VideoFrame, sequence: number, about: About): Promise<void> {
    const decoder = this.decoder;
    const image = await Planes.of(frame).catch(() => undefined);
    if (image === undefined) this.unpacks = false;
    else if (this.decoder === decoder) this.show({ image, sequence, ...about });
    else image.close(); // of a stream that has ended meanwhile
  }

  private async still(data: Uint8Array<ArrayBuffer>, sequence: number, about: About): Promise<void> {
    const image = await createImageBitmap(new Blob([data], { type: "image/jpeg" }));
    this.show({ image, sequence, ...about });
  }

  private show(picture: Picture): void {
    this.error = "";
    this.waiting = false;
    this.decodedMs.push(performance.now());
    if (this.newest !== undefined) {
      if (!this.catchingUp) this.dropped += 1;
      this.newest.image.close();
    }
    this.newest = picture;
  }
}

/** `avc1.PPCCLL` of the sequence parameter set in an Annex B key picture. */
export function codecOf(data: Uint8Array): string | undefined {
  const most = Math.min(data.length - 4, 4096);
  for (let at = 0; at + 6 < most; at++) {
    if (data[at] === 0 && data[at + 1] === 0 && data[at + 2] === 1 && (data[at + 3]! & 0x1f) === 7) {
      return `avc1.${[...data.subarray(at + 4, at + 7)].map((octet) => octet.toString(16).padStart(2, "0")).join("")}`;
    }
  }
  return undefined;
}
