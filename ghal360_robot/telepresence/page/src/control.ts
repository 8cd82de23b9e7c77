/** The small socket: what the robot tells, what the operator wants. Reconnects for ever; never drives by itself. */

import { RobotClock } from "./clock.ts";
import type { FromPage, FromServer } from "./protocol.gen.ts";
import { whyNot } from "./validate.ts";

const PING_MS = 500;
const FIRST_PAUSE_MS = 250;
const LONGEST_PAUSE_MS = 4000;
/** No message for so long: the connection is dead although nobody has said so. A healthy robot sends 20 a second. */
const SILENT_MS = 3000;

export type Handlers = { [M in FromServer as M["kind"]]?: (message: M) => void };

export class Control {
  readonly clock = new RobotClock();
  conn = "";
  onLost: () => void = () => undefined;
  /** Why there is no connection, in words. */
  onTrouble: (words: string, loginNeeded: boolean) => void = () => undefined;
  private socket: WebSocket | undefined;
  private pauseMs = FIRST_PAUSE_MS;
  private heardMs = 0;

  constructor(private readonly handlers: Handlers) {
    setInterval(() => this.beat(), PING_MS);
  }

  get open(): boolean {
    return this.socket?.readyState === WebSocket.OPEN && this.conn !== "";
  }

  connect(): void {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ctl`);
    this.socket = socket;
    this.heardMs = performance.now();
    socket.onmessage = (event) => this.take(String(event.data));
    socket.onclose = (event) => {
      if (this.socket === socket) this.lost(event.reason);
    };
  }

  /** False where there is no connection to send on. */
  send(message: FromPage): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  close(): void {
    this.socket?.close();
  }

  private take(text: string): void {
    this.heardMs = performance.now();
    const message: unknown = JSON.parse(text);
    const wrong = whyNot("FromServer", message);
    if (wrong) {
      console.error(`the robot said what this page does not understand: ${wrong}`);
      return;
    }
    this.dispatch(message as FromServer);
  }

  private dispatch(message: FromServer): void {
    if (message.kind === "probe") this.send({ kind: "echo", nonce: message.nonce });
    if (message.kind === "pong") {
      this.clock.note(message.t0, message.received_us, message.sent_us, performance.now());
    }
    if (message.kind === "hello") {
      this.conn = message.conn;
      this.pauseMs = FIRST_PAUSE_MS;
      for (let count = 0; count < 3; count++) this.ping();
    }
    (this.handlers[message.kind] as ((message: FromServer) => void) | undefined)?.(message);
  }

  private ping(): void {
    this.send({ kind: "ping", t0: performance.now() });
  }

  private beat(): void {
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    this.ping();
    if (performance.now() - this.heardMs > SILENT_MS && document.visibilityState === "visible") {
      const socket = this.socket;
      this.lost("the robot fell silent");
      socket.close();
    }
  }

  private lost(reason: string): void {
    this.socket = undefined;
    this.conn = "";
    this.clock.forget();
    this.onLost();
    const pauseMs = this.pauseMs * (0.75 + Math.random() / 2);
    this.pauseMs = Math.min(2 * this.pauseMs, LONGEST_PAUSE_MS);
    void this.explain(reason).then((again) => {
      if (again) setTimeout(() => this.connect(), pauseMs);
    });
  }

  /** A browser does not say why a socket was refused; a plain request does. */
  private async explain(reason: string): Promise<boolean> {
    try {
      const answer = await fetch("/whoami", { cache: "no-store" });
      if (answer.status === 401) {
        this.onTrouble("this robot asks for a token", true);
        return false;
      }
      this.onTrouble(reason || (answer.ok ? "the connection was lost" : await answer.text()), false);
    } catch {
      this.onTrouble("the robot cannot be reached", false);
    }
    return true;
  }
}

/** Exchange a token for a cookie that scripts cannot read. */
export async function logIn(token: string): Promise<boolean> {
  const answer = await fetch("/login", {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ token }),
  });
  return answer.ok;
}
