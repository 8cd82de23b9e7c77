/** A headset: offered only where there is one. The trigger is the dead man, the squeeze stops. */

import type { Matrix4 } from "three";
import { Euler } from "three";
import type { Drive } from "./drive.ts";
import { stickOf } from "./drive.ts";
import type { Gaze } from "./gaze.ts";
import type { World } from "./scene.ts";

const SOURCE = "xr";

export class Headset {
  private session: XRSession | undefined;
  private triggerSeen = false;

  constructor(
    private readonly world: World,
    private readonly gaze: Gaze,
    private readonly drive: Drive,
    private readonly button: HTMLButtonElement,
  ) {
    button.onclick = () => void world.scene.enterVR();
    world.scene.addEventListener("enter-vr", () => this.entered());
    world.scene.addEventListener("exit-vr", () => this.left());
    void this.offer();
    navigator.xr?.addEventListener("devicechange", () => void this.offer());
  }

  get active(): boolean {
    return this.session !== undefined;
  }

  /** One drawn frame: head and hands as the device reports them. */
  step(): void {
    if (this.session === undefined) return;
    const camera = this.world.scene.renderer.xr.getCamera();
    const head = new Euler().setFromRotationMatrix(camera.matrixWorld, "YXZ");
    this.gaze.set(head.y, head.x);
    this.gaze.roll = head.z;
    const eyes = camera.cameras.map((eye) => fovOf(eye.projectionMatrix));
    if (eyes.length > 0) {
      this.gaze.fovOfDevice = { h: Math.max(...eyes.map((eye) => eye.h)), v: Math.max(...eyes.map((eye) => eye.v)) };
    }
    this.hands(this.session);
  }

  private hands(session: XRSession): void {
    if ([...session.inputSources].some(({ gamepad }) => gamepad?.buttons[1]?.pressed === true)) {
      this.release();
      this.drive.estop();
      return;
    }
    let pressed = false;
    let stick: ReturnType<typeof stickOf> = null;
    for (const { gamepad } of session.inputSources) {
      if (!gamepad?.buttons[0]?.pressed) continue;
      pressed = true;
      stick ??= stickOf(gamepad.axes[2] ?? 0, gamepad.axes[3] ?? 0);
    }
    if (!pressed) {
      this.triggerSeen = true;
      this.drive.let(SOURCE);
    } else if (this.triggerSeen) this.drive.hold(SOURCE, stick);
  }

  private async offer(): Promise<void> {
    const there = (await navigator.xr?.isSessionSupported("immersive-vr").catch(() => false)) ?? false;
    this.button.hidden = !there;
  }

  private entered(): void {
    const session = this.world.scene.renderer.xr.getSession();
    if (session === null) return;
    this.session = session;
    this.triggerSeen = false;
    this.gaze.mode = "xr";
    this.world.front.visible = true;
    session.addEventListener("visibilitychange", () => {
      if (session.visibilityState !== "visible") this.release();
    });
    session.addEventListener("end", () => this.left());
    session.addEventListener("inputsourceschange", () => this.release());
  }

  private left(): void {
    this.session = undefined;
    this.release();
    this.gaze.mode = "screen";
    this.gaze.fovOfDevice = undefined;
    this.gaze.roll = 0;
    this.world.front.visible = false;
  }

  private release(): void {
    this.triggerSeen = false;
    this.drive.release();
  }
}

/** What a projection shows, as angles. */
export function fovOf(projection: Matrix4): { h: number; v: number } {
  const e = projection.elements;
  const half = (scale: number, shift: number): number => Math.atan((1 + shift) / scale) + Math.atan((1 - shift) / scale);
  return { h: half(e[0], e[8]), v: half(e[5], e[9]) };
}
