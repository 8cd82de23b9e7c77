/** What a headset shows in front of the eyes, where nothing of the document can be seen: cue, state, reason. */

import { CanvasTexture, Mesh, MeshBasicMaterial, PlaneGeometry, SRGBColorSpace } from "three";
import type { Group } from "three";

const SIZE = { width: 768, height: 192 };

export class Panel {
  private readonly context: CanvasRenderingContext2D;
  private readonly texture: CanvasTexture;
  private drawn = "";

  constructor(parent: Group) {
    const canvas = document.createElement("canvas");
    canvas.width = SIZE.width;
    canvas.height = SIZE.height;
    this.context = canvas.getContext("2d")!;
    this.texture = new CanvasTexture(canvas);
    this.texture.colorSpace = SRGBColorSpace;
    const material = new MeshBasicMaterial({ map: this.texture, transparent: true, depthTest: false });
    const plate = new Mesh(new PlaneGeometry(1.2, 0.3), material);
    plate.position.set(0, -0.55, -1.6);
    plate.rotation.x = -0.25;
    plate.renderOrder = 10;
    parent.add(plate);
  }

  draw(cue: string, state: string, detail: string): void {
    const key = `${cue}|${state}|${detail}`;
    if (key === this.drawn) return;
    this.drawn = key;
    const c = this.context;
    c.clearRect(0, 0, SIZE.width, SIZE.height);
    c.fillStyle = "rgba(16, 20, 24, 0.75)";
    c.beginPath();
    c.roundRect(0, 0, SIZE.width, SIZE.height, 24);
    c.fill();
    c.textAlign = "center";
    c.fillStyle = "#ffd23f";
    c.font = "bold 90px system-ui, sans-serif";
    if (cue === "left") c.fillText("◀", 70, 125);
    if (cue === "right") c.fillText("▶", SIZE.width - 70, 125);
    c.fillStyle = "#f4f6f8";
    c.font = "bold 48px system-ui, sans-serif";
    c.fillText(cue === "confirm" ? "Is this it?" : state, SIZE.width / 2, 75, SIZE.width - 240);
    c.font = "32px system-ui, sans-serif";
    c.fillText(detail, SIZE.width / 2, 140, SIZE.width - 240);
    this.texture.needsUpdate = true;
  }
}
