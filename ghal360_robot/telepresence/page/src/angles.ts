/** Radians, counter-clockwise, zero ahead. */

export const TAU = 2 * Math.PI;

/** The same direction in [-pi, pi). */
export function wrap(angle: number): number {
  return angle - TAU * Math.floor((angle + Math.PI) / TAU);
}

export function degrees(angle: number): number {
  return (angle * 180) / Math.PI;
}

export function radians(angle: number): number {
  return (angle * Math.PI) / 180;
}

export function clamp(value: number, least: number, most: number): number {
  return Math.min(Math.max(value, least), most);
}

/** The horizontal field of view of a picture `aspect` times as wide as high. */
export function horizontal(fovV: number, aspect: number): number {
  return 2 * Math.atan(Math.tan(fovV / 2) * aspect);
}
