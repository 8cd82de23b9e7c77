/** The floor seen from above: the robot as a red circle, where the operator looks, the target, the way driven. */

import { degrees, wrap } from "./angles.ts";
import type { Floor, Scan, State } from "./protocol.gen.ts";

const METRES_ACROSS = 9;
const ROBOT_M = 0.4;
const TARGET_UNKNOWN_M = 2.5;

export class FloorPlan {
  private readonly context: CanvasRenderingContext2D;
  private picture: HTMLImageElement | undefined;
  private floor: Floor | undefined;

  constructor(canvas: HTMLCanvasElement) {
    this.context = canvas.getContext("2d")!;
  }

  load(floor: Floor): void {
    const image = new Image();
    image.onload = () => {
      this.picture = image;
      this.floor = floor;
    };
    image.src = `data:image/png;base64,${floor.png}`;
  }

  /** `gaze` is in the base frame, like everything of `state` and `scan`. */
  draw(state: State | undefined, scan: Scan | undefined, gaze: number, fovH: number): void {
    const c = this.context;
    const size = c.canvas.width;
    const scale = size / METRES_ACROSS;
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.fillStyle = "#cdcdcd";
    c.fillRect(0, 0, size, size);
    const pose = state?.pose ?? { x: 0, y: 0, yaw: 0 };
    // The odometry's x points up, its y to the left; the robot is in the middle.
    c.setTransform(0, -scale, -scale, 0, size / 2, size / 2);
    c.translate(-pose.x, -pose.y);
    this.drawFloor(c);
    c.translate(pose.x, pose.y);
    c.rotate(pose.yaw);
    if (scan !== undefined) drawScan(c, scan);
    drawWedge(c, gaze, fovH);
    if (state !== undefined) drawAims(c, state);
    drawRobot(c);
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.fillStyle = "#101418";
    c.font = "12px system-ui, sans-serif";
    c.fillText(`${METRES_ACROSS} m · looking ${Math.round(degrees(wrap(gaze)))}° · ${Math.round(degrees(fovH))}° wide`, 6, size - 6);
  }

  private drawFloor(c: CanvasRenderingContext2D): void {
    const { floor, picture } = this;
    if (floor === undefined || picture === undefined) return;
    const [width, height] = [picture.width * floor.resolution_m, picture.height * floor.resolution_m];
    c.save();
    // The picture's rows run against y.
    c.translate(floor.x, floor.y + height);
    c.scale(1, -1);
    c.imageSmoothingEnabled = false;
    c.drawImage(picture, 0, 0, width, height);
    c.restore();
    c.beginPath();
    for (const [x, y] of floor.path) c.lineTo(x, y);
    c.strokeStyle = "#3f8cff";
    c.lineWidth = 0.06;
    c.stroke();
  }
}

function drawScan(c: CanvasRenderingContext2D, scan: Scan): void {
  c.fillStyle = "#8a4b00";
  for (const [index, cm] of scan.cm.entries()) {
    if (cm === 0) continue;
    const yaw = scan.first + (index + 0.5) * scan.step;
    c.fillRect((cm / 100) * Math.cos(yaw) - 0.03, (cm / 100) * Math.sin(yaw) - 0.03, 0.06, 0.06);
  }
}

function drawWedge(c: CanvasRenderingContext2D, gaze: number, fovH: number): void {
  c.beginPath();
  c.moveTo(0, 0);
  c.arc(0, 0, 1.6, gaze - fovH / 2, gaze + fovH / 2);
  c.closePath();
  paint(c, "rgb(36 80 107 / 35%)", "#24506b", 0.04);
}

function drawAims(c: CanvasRenderingContext2D, state: State): void {
  if (state.intention !== null) ray(c, state.intention, 1.2, "#0a7d4f", 0.08);
  if (state.target === null) return;
  const away = state.target_m ?? TARGET_UNKNOWN_M;
  ray(c, state.target, away, "#a67c00", 0.04);
  c.beginPath();
  const [x, y] = [away * Math.cos(state.target), away * Math.sin(state.target)];
  for (let corner = 0; corner < 10; corner++) {
    const reach = corner % 2 ? 0.1 : 0.26;
    c.lineTo(x + reach * Math.cos((corner * Math.PI) / 5), y + reach * Math.sin((corner * Math.PI) / 5));
  }
  c.closePath();
  paint(c, "#ffd23f", "#101418", 0.03);
}

/** The path so far: filled, with an edge. */
function paint(c: CanvasRenderingContext2D, inside: string, edge: string, width: number): void {
  c.fillStyle = inside;
  c.strokeStyle = edge;
  c.lineWidth = width;
  c.fill();
  c.stroke();
}

function ray(c: CanvasRenderingContext2D, yaw: number, length: number, color: string, width: number): void {
  c.beginPath();
  c.moveTo(0, 0);
  c.lineTo(length * Math.cos(yaw), length * Math.sin(yaw));
  c.strokeStyle = color;
  c.lineWidth = width;
  c.stroke();
}

function drawRobot(c: CanvasRenderingContext2D): void {
  c.beginPath();
  c.arc(0, 0, ROBOT_M, 0, 2 * Math.PI);
  paint(c, "rgb(214 30 48 / 85%)", "#fff", 0.05);
  c.beginPath();
  c.moveTo(0, 0);
  c.lineTo(ROBOT_M, 0);
  c.stroke();
}
