/** The base's yaw a moment ago: an unwound picture has to be turned by the yaw it was taken at. */

import { wrap } from "./angles.ts";

const LENGTH = 60;

export class Trail {
  private readonly yaws: { us: number; yaw: number }[] = [];

  note(us: number, yaw: number): void {
    this.yaws.push({ us, yaw });
    if (this.yaws.length > LENGTH) this.yaws.shift();
  }

  at(us: number): number {
    const after = this.yaws.findIndex((entry) => entry.us >= us);
    if (after < 0) return this.yaws.at(-1)?.yaw ?? 0;
    const [a, b] = [this.yaws[Math.max(after - 1, 0)]!, this.yaws[after]!];
    const share = b.us > a.us ? (us - a.us) / (b.us - a.us) : 1;
    return wrap(a.yaw + Math.min(Math.max(share, 0), 1) * wrap(b.yaw - a.yaw));
  }
}
