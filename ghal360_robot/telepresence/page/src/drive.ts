/** The driver's hands: who holds the dead man, what the stick wants, and the messages that say so.

Every way of holding ends in a release that cannot be missed: key up, pointer lost, window left, tab hidden, page
closed, gamepad gone, headset taken off, connection lost. After any of them a fresh press is needed. */

import { clamp } from "./angles.ts";
import type { Control } from "./control.ts";
import type { Gaze } from "./gaze.ts";
import type { Operate, Right, State, Stick } from "./protocol.gen.ts";

const PERIOD_MS = 33;
/** An emergency stop is repeated until the robot shows that it has it. */
const STOP_AGAIN_MS = 300;
const DEAD_ZONE = 0.15;

const STICKS: Record<string, Stick> = {
  KeyW: { v: 1, w: 0 },
  KeyS: { v: -1, w: 0 },
  KeyA: { v: 0, w: 1 },
  KeyD: { v: 0, w: -1 },
};
const LOOK_KEY = "KeyF";

/** Something held that keeps the robot going: by looking where `stick` is null. */
type Hold = Stick | null;

export class Drive {
  /** Share of the robot's highest speed that the keys ask for. */
  throttle = 0.7;
  right: Right | undefined;
  state: State | undefined;
  onChange: () => void = () => undefined;
  /** Where the view looks in the base frame. */
  heading: () => number = () => 0;
  private readonly holds = new Map<string, Hold>();
  private seq = 0;
  private arms = 0;
  private disarms = 0;
  private founds = 0;
  private presses = 0;
  private stopWanted = false;
  private stopSentMs = 0;
  private padSeen = false;

  constructor(
    private readonly control: Control,
    private readonly gaze: Gaze,
  ) {
    setInterval(() => this.beat(), PERIOD_MS);
    addEventListener("blur", () => this.release());
    addEventListener("pagehide", () => this.release());
    document.addEventListener("visibilitychange", () => {
      if (document.visibilityState !== "visible") this.release();
    });
    addEventListener("gamepaddisconnected", () => this.release());
  }

  get held(): boolean {
    return this.holds.size > 0;
  }

  get looking(): boolean {
    return this.held && this.stick === null;
  }

  get mayDrive(): boolean {
    return this.right?.yours === true;
  }

  /** What all held sources want together; null while driving by looking. */
  get stick(): Hold {
    const sticks = [...this.holds.values()].filter((hold) => hold !== null);
    if (sticks.length === 0) return null;
    const sum = sticks.reduce((all, one) => ({ v: all.v + one.v, w: all.w + one.w }), { v: 0, w: 0 });
    return { v: clamp(sum.v, -1, 1), w: clamp(sum.w, -1, 1) };
  }

  /** True where the key is one of ours. */
  press(code: string, repeat: boolean): boolean {
    const stick = STICKS[code];
    if (stick === undefined && code !== LOOK_KEY) return false;
    if (!repeat) {
      const share = this.throttle;
      this.hold(code, stick === undefined ? null : { v: stick.v * share, w: stick.w * share });
    }
    return true;
  }

  lift(code: string): void {
    this.let(code);
  }

  hold(source: string, wish: Hold): void {
    if (!this.mayDrive) return;
    this.holds.set(source, wish);
    this.changed();
  }

  let(source: string): void {
    if (this.holds.delete(source)) this.changed();
  }

  /** Everything is let go, whatever is still pressed. */
  release(): void {
    this.padSeen = false;
    if (!this.held) return;
    this.holds.clear();
    this.changed();
  }

  /** The connection is gone: counts begin anew with the next. */
  lost(): void {
    this.release();
    this.right = undefined;
    this.seq = this.arms = this.disarms = this.founds = this.presses = 0;
    this.onChange();
  }

  arm(): void {
    this.arms += 1;
    this.stopWanted = false;
    this.changed();
  }

  found(): void {
    this.founds += 1;
    this.changed();
  }

  /** Anybody may do this, driver or not. */
  disarm(): void {
    this.release();
    this.disarms += 1;
    this.presses += 1;
    this.control.send({ kind: "stop", level: "disarm", press: this.presses });
    this.changed();
  }

  estop(): void {
    this.release();
    this.stopWanted = true;
    this.sendStop();
    this.onChange();
  }

  /** What the robot says ends an emergency stop that had to be repeated. */
  told(state: State): void {
    this.state = state;
    if (state.arm === "estop") this.stopWanted = false;
  }

  private beat(): void {
    this.pollGamepads();
    if (this.stopWanted && performance.now() - this.stopSentMs > STOP_AGAIN_MS) this.sendStop();
    this.send();
  }

  private sendStop(): void {
    this.presses += 1;
    this.stopSentMs = performance.now();
    this.control.send({ kind: "stop", level: "estop", press: this.presses });
  }

  private changed(): void {
    this.send();
    this.onChange();
  }

  private send(): void {
    if (!this.mayDrive || !this.control.open || !this.control.clock.known) return;
    this.seq += 1;
    const message: Operate = {
      kind: "operate",
      conn: this.control.conn,
      seq: this.seq,
      sent_us: this.control.clock.nowUs(),
      yaw: this.heading(),
      pitch: this.gaze.pitch,
      fov_h: this.gaze.fovH,
      fov_v: this.gaze.fovUp,
      mode: this.gaze.mode,
      deadman: this.held,
      stick: this.stick,
      arm: this.arms,
      disarm: this.disarms,
      found: this.founds,
    };
    this.control.send(message);
  }

  /** Right trigger or bumper holds; the left stick steers, untouched it is driving by looking. */
  private pollGamepads(): void {
    const pad = navigator.getGamepads().find((candidate) => candidate?.connected && candidate.mapping === "standard");
    if (!pad) {
      this.let("gamepad");
      return;
    }
    if (pad.buttons[1]?.pressed) this.estop();
    const pressed = pad.buttons[7]?.pressed === true || pad.buttons[5]?.pressed === true;
    if (!pressed) {
      this.padSeen = true;
      this.let("gamepad");
    } else if (this.padSeen) this.hold("gamepad", stickOf(pad.axes[0] ?? 0, pad.axes[1] ?? 0));
  }
}

/** A thumb stick as a wish: up is forward, left turns left; null where nobody touches it. */
export function stickOf(x: number, y: number): Hold {
  if (Math.hypot(x, y) < DEAD_ZONE) return null;
  return { v: clamp(-y, -1, 1), w: clamp(-x, -1, 1) };
}
