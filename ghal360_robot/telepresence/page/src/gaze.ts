/** Where the operator looks: by dragging, keys, touch or the phone's own orientation; and how wide. */

import { clamp, horizontal, radians, wrap } from "./angles.ts";

const MAX_PITCH = radians(85);
export const MIN_FOV = radians(30);
export const MAX_FOV = radians(110);
export const FIRST_FOV = radians(75);
/** One press of an arrow key; held longer than a tap, the view turns on. */
const STEP = radians(15);
const TAP_MS = 250;
const TURN_RATE = radians(60);
/** A step is not a jump: the eye has to follow. */
const GLIDE_RATE = radians(240);

const TURNS: Record<string, [number, number]> = {
  ArrowLeft: [1, 0],
  ArrowRight: [-1, 0],
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
};

export class Gaze {
  /** Of the view in the scene, radians; `yaw` counter-clockwise. */
  yaw = 0;
  pitch = 0;
  roll = 0;
  fovV = FIRST_FOV;
  aspect = 16 / 9;
  mode: "screen" | "touch" | "xr" = "screen";
  /** In a headset the device says how wide. */
  fovOfDevice: { h: number; v: number } | undefined;
  onZoom: () => void = () => undefined;
  private goalYaw = 0;
  private goalPitch = 0;
  private readonly held = new Map<string, number>();
  private readonly fingers = new Map<number, { x: number; y: number }>();
  private tilt: { yawOffset: number; listener: (event: DeviceOrientationEvent) => void } | undefined;

  constructor(private readonly surface: HTMLElement) {
    surface.addEventListener("pointerdown", (event) => this.touch(event));
    surface.addEventListener("pointermove", (event) => this.drag(event));
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"] as const) {
      surface.addEventListener(name, (event) => this.fingers.delete(event.pointerId));
    }
    surface.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    addEventListener("blur", () => this.held.clear());
  }

  get fovH(): number {
    return this.fovOfDevice?.h ?? horizontal(this.fovV, this.aspect);
  }

  get fovUp(): number {
    return this.fovOfDevice?.v ?? this.fovV;
  }

  /** Look there at once. */
  set(yaw: number, pitch: number): void {
    this.yaw = this.goalYaw = wrap(yaw);
    this.pitch = this.goalPitch = clamp(pitch, -MAX_PITCH, MAX_PITCH);
  }

  /** Turn the view together with everything in it, without anybody noticing. */
  carry(by: number): void {
    this.yaw = wrap(this.yaw + by);
    this.goalYaw = wrap(this.goalYaw + by);
  }

  zoom(fovV: number): void {
    this.fovV = clamp(fovV, MIN_FOV, MAX_FOV);
    this.onZoom();
  }

  /** True where the key is one of ours. */
  press(code: string, repeat: boolean): boolean {
    if (code === "Home") {
      this.goalYaw = 0;
      this.goalPitch = 0;
      return true;
    }
    const turn = TURNS[code];
    if (turn === undefined) return false;
    if (!repeat) {
      this.held.set(code, performance.now());
      this.goalYaw = wrap(this.goalYaw + turn[0] * STEP);
      this.goalPitch = clamp(this.goalPitch + turn[1] * STEP, -MAX_PITCH, MAX_PITCH);
    }
    return true;
  }

  lift(code: string): void {
    this.held.delete(code);
  }

  /** Whether the view has arrived where the keys sent it. */
  get settled(): boolean {
    return this.held.size === 0 && wrap(this.goalYaw - this.yaw) === 0 && this.goalPitch === this.pitch;
  }

  /** One drawn frame later. */
  step(nowMs: number, elapsedMs: number): void {
    for (const [code, sinceMs] of this.held) {
      if (nowMs - sinceMs < TAP_MS) continue;
      const [left, up] = TURNS[code]!;
      const turned = (TURN_RATE * elapsedMs) / 1000;
      this.goalYaw = wrap(this.goalYaw + left * turned);
      this.goalPitch = clamp(this.goalPitch + up * turned, -MAX_PITCH, MAX_PITCH);
    }
    const most = (GLIDE_RATE * elapsedMs) / 1000;
    this.yaw = wrap(this.yaw + clamp(wrap(this.goalYaw - this.yaw), -most, most));
    this.pitch += clamp(this.goalPitch - this.pitch, -most, most);
  }

  /** Follow the phone's orientation, or stop following. Resolves to whether it is followed now. */
  async followDevice(): Promise<boolean> {
    if (this.tilt !== undefined) {
      removeEventListener("deviceorientation", this.tilt.listener);
      this.tilt = undefined;
      this.roll = 0;
      return false;
    }
    const asks = DeviceOrientationEvent as unknown as { requestPermission?: () => Promise<string> };
    if (asks.requestPermission !== undefined && (await asks.requestPermission()) !== "granted") return false;
    let yawOffset: number | undefined;
    const listener = (event: DeviceOrientationEvent): void => {
      const angles = ofDevice(event, screen.orientation?.angle ?? 0);
      if (angles === undefined) return;
      yawOffset ??= wrap(this.yaw - angles.yaw);
      this.mode = "touch";
      this.roll = angles.roll;
      this.set(angles.yaw + yawOffset, angles.pitch);
    };
    addEventListener("deviceorientation", listener);
    this.tilt = { yawOffset: 0, listener };
    return true;
  }

  private touch(event: PointerEvent): void {
    if (event.button !== 0) return;
    this.surface.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    this.mode = event.pointerType === "mouse" ? "screen" : "touch";
  }

  /** Take the scene by the hand: what is under the finger stays there, whatever the field of view. */
  private drag(event: PointerEvent): void {
    const before = this.fingers.get(event.pointerId);
    if (before === undefined) return;
    const after = { x: event.clientX, y: event.clientY };
    if (this.fingers.size === 2) this.pinch(event.pointerId, before, after);
    else {
      const perPixel = this.fovV / this.surface.clientHeight;
      this.set(this.yaw + (after.x - before.x) * perPixel, this.pitch + (after.y - before.y) * perPixel);
    }
    this.fingers.set(event.pointerId, after);
  }

  private pinch(id: number, before: { x: number; y: number }, after: { x: number; y: number }): void {
    const other = [...this.fingers].find(([finger]) => finger !== id)?.[1];
    if (other === undefined) return;
    const apart = (finger: { x: number; y: number }): number => Math.hypot(finger.x - other.x, finger.y - other.y);
    this.zoom((this.fovV * Math.max(apart(before), 1)) / Math.max(apart(after), 1));
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    this.zoom(this.fovV * Math.exp(clamp(event.deltaY, -200, 200) / 1000));
  }
}

/** The view through a phone held up, from the angles its browser gives (degrees, Z-X'-Y''). */
export function ofDevice(
  event: Pick<DeviceOrientationEvent, "alpha" | "beta" | "gamma">,
  screenAngle: number,
): { yaw: number; pitch: number; roll: number } | undefined {
  if (event.alpha === null || event.beta === null || event.gamma === null) return undefined;
  const [a, b, c] = [radians(event.alpha), radians(event.beta), radians(event.gamma)];
  // Columns of the rotation from the device's axes to the earth's (x east, y north, z up).
  const [ca, sa, cb, sb, cc, sc] = [Math.cos(a), Math.sin(a), Math.cos(b), Math.sin(b), Math.cos(c), Math.sin(c)];
  const right = [ca * cc - sa * sb * sc, sa * cc + ca * sb * sc, -cb * sc] as const;
  const top = [-sa * cb, ca * cb, sb] as const;
  const out = [ca * sc + sa * sb * cc, sa * sc - ca * sb * cc, cb * cc] as const;
  const turn = radians(screenAngle);
  const up = [0, 1, 2].map((k) => top[k]! * Math.cos(turn) + right[k]! * Math.sin(turn));
  const side = [0, 1, 2].map((k) => right[k]! * Math.cos(turn) - top[k]! * Math.sin(turn));
  const ahead = out.map((value) => -value);
  return {
    yaw: Math.atan2(-ahead[0]!, ahead[1]!),
    pitch: Math.asin(clamp(ahead[2]!, -1, 1)),
    roll: Math.atan2(side[2]!, up[2]!),
  };
}
