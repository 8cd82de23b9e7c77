/** What stands around the operator: the panorama on a sphere, the lidar's ring, boxes, and the camera in the middle.

Everything of the robot hangs under one group in the base frame: ahead is -z, left is -x, so that a yaw of the base
frame is a rotation about y. In the unwound view the group turns with the base and the world stands still. */

import "./env.ts";
import AFRAME, { type AEntity, type AScene } from "aframe";
import {
  BackSide,
  BufferGeometry,
  Color,
  DoubleSide,
  Float32BufferAttribute,
  Group,
  LineSegments,
  LineBasicMaterial,
  LinearFilter,
  Mesh,
  MeshBasicMaterial,
  PerspectiveCamera,
  SphereGeometry,
  SRGBColorSpace,
  Texture,
  Vector3,
  VideoFrameTexture,
} from "three";
import { radians, TAU, wrap } from "./angles.ts";
import { Planes, PlanesMaterial } from "./planes.ts";
import type { Box, Scan } from "./protocol.gen.ts";
import type { Picture } from "./video.ts";

/** Who draws where there is no GPU. */
const SOFTWARE = /swiftshader|llvmpipe|softpipe|basic render/i;
/** Its share of the screen's pixels each way. A 2K panorama has five pixels a degree, so few are hardly fewer. */
const SOFTWARE_SHARE = 0.5;
const SPHERE_M = 50;
const RING_M = 40;
const BOX_M = 38;
/** Where floor meets wall, the camera 1.2 m up: the ring lies a little below the horizon. */
const RING_PITCH = radians(-7);
const RING_NEAR_M = 0.4;
const RING_FAR_M = 8;
const TARGET_COLOR = 0xffd23f;
const OTHER_COLOR = 0x9fb4c7;
const BOX_WIDTH = radians(0.35);
const HATCH = radians(1);
const NEAR_COLOR = new Color(0xffb000);
const FAR_COLOR = new Color(0x3f8cff);
const BLIND_COLOR = new Color(0x555555);

/** The direction of a yaw and pitch in the base frame, `distance` away. */
export function point(yaw: number, pitch: number, distance: number): Vector3 {
  const flat = Math.cos(pitch) * distance;
  return new Vector3(-Math.sin(yaw) * flat, Math.sin(pitch) * distance, -Math.cos(yaw) * flat);
}

export class World {
  readonly scene: AScene;
  readonly camera: PerspectiveCamera;
  /** In the base frame. */
  readonly base = new Group();
  /** In front of the operator, wherever they look; seen in a headset only. */
  readonly front = new Group();
  onTick: (timeMs: number, elapsedMs: number) => void = () => undefined;
  private readonly sphere: Mesh<SphereGeometry, MeshBasicMaterial | PlanesMaterial>;
  /** For pictures in memory, and for whole ones. */
  private readonly planes = new PlanesMaterial();
  private readonly whole = new MeshBasicMaterial({ color: 0x101418, side: BackSide });
  private texture: Texture | undefined;
  private shown: Picture | undefined;
  private readonly ring: LineSegments<BufferGeometry, LineBasicMaterial>;
  private readonly boxes = new Group();
  private boxesDrawn = "";
  /** Whether anything looks different from the last frame drawn. */
  private changed = true;

  private constructor(scene: AScene, camera: PerspectiveCamera) {
    this.scene = scene;
    this.camera = camera;
    const geometry = new SphereGeometry(SPHERE_M, 96, 64);
    this.sphere = new Mesh<SphereGeometry, MeshBasicMaterial | PlanesMaterial>(geometry, this.whole);
    this.sphere.scale.x = -1;
    this.sphere.rotation.y = -Math.PI / 2;
    this.ring = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ vertexColors: true }));
    this.ring.frustumCulled = false;
    this.base.add(this.sphere, this.ring, this.boxes);
    this.front.visible = false;
    scene.object3D.add(this.base);
    camera.add(this.front);
    this.drawOnChange();
    this.sparePixels();
    scene.addEventListener("exit-vr", () => this.sparePixels());
  }

  /** Colouring pixels on processors takes more of them than decoding does, and the robot may share them. */
  private sparePixels(): void {
    const context = this.scene.renderer.getContext();
    const about = context.getExtension("WEBGL_debug_renderer_info");
    const who = about === null ? "" : String(context.getParameter(about.UNMASKED_RENDERER_WEBGL));
    if (SOFTWARE.test(who)) this.scene.renderer.setPixelRatio(SOFTWARE_SHARE);
    this.changed = true;
  }

  /** A phone's battery, and a computer without a GPU, are spared frames in which nothing moves. */
  private drawOnChange(): void {
    const renderer = this.scene.renderer;
    const draw = renderer.render.bind(renderer);
    renderer.render = (what, camera) => {
      if (!this.changed && !renderer.xr.isPresenting) return;
      this.changed = false;
      draw(what, camera);
    };
    new ResizeObserver(() => (this.changed = true)).observe(this.scene.canvas);
  }

  /** Build the scene in `parent`; resolves when A-Frame draws. */
  static create(parent: HTMLElement): Promise<World> {
    return new Promise((resolve) => {
      let world: World | undefined;
      AFRAME.registerComponent("telepresence", {
        tick(timeMs: number, elapsedMs: number) {
          world?.onTick(timeMs, elapsedMs);
        },
      });
      const scene = document.createElement("a-scene") as unknown as AScene;
      const attributes: Record<string, string> = {
        telepresence: "",
        background: "color: #101418",
        "xr-mode-ui": "enabled: false",
        "device-orientation-permission-ui": "enabled: false",
        "loading-screen": "enabled: false",
        "keyboard-shortcuts": "enterVR: false",
        webxr: "requiredFeatures: ; optionalFeatures: local-floor; referenceSpaceType: local",
        renderer: "antialias: false; maxCanvasWidth: 1920; maxCanvasHeight: 1920",
      };
      for (const [name, value] of Object.entries(attributes)) scene.setAttribute(name, value);
      const camera = document.createElement("a-entity") as unknown as AEntity;
      camera.setAttribute("camera", "near: 0.05; far: 200");
      camera.setAttribute("position", "0 0 0");
      scene.append(camera);
      parent.append(scene);
      const ready = (): void => {
        world = new World(scene, scene.camera as PerspectiveCamera);
        resolve(world);
      };
      if (scene.hasLoaded) ready();
      else scene.addEventListener("loaded", ready, { once: true });
    });
  }

  /** Where the picture's centre column looks in the base frame. */
  set cameraYaw(yaw: number) {
    this.sphere.rotation.y = yaw - Math.PI / 2;
    this.changed = true;
  }

  /** The yaw of the base in the scene: 0, or the robot's own in the unwound view. */
  set baseYaw(yaw: number) {
    this.base.rotation.y = wrap(yaw);
    this.changed = true;
  }

  get baseYaw(): number {
    return this.base.rotation.y;
  }

  look(yaw: number, pitch: number, roll: number, fovV: number): void {
    const old = this.camera.rotation;
    if (old.x !== pitch || old.y !== yaw || old.z !== roll) this.changed = true;
    old.set(pitch, yaw, roll, "YXZ");
    const fov = (fovV * 180) / Math.PI;
    if (Math.abs(this.camera.fov - fov) > 1e-3) {
      this.changed = true;
      this.camera.fov = fov;
      this.camera.updateProjectionMatrix();
    }
  }

  /** Draw this picture from now on, and let go of the one before. */
  show(picture: Picture): void {
    const old = this.shown;
    this.shown = picture;
    if (picture.image instanceof Planes) {
      this.planes.show(picture.image);
      this.sphere.material = this.planes;
    } else {
      this.showWhole(picture, picture.image, old);
      this.sphere.material = this.whole;
    }
    this.changed = true;
    old?.image.close();
  }

  private showWhole(picture: Picture, image: VideoFrame | ImageBitmap, old: Picture | undefined): void {
    const fits = old !== undefined && old.width === picture.width && kind(old.image) === kind(image);
    if (this.texture === undefined || !fits) {
      this.texture?.dispose();
      this.texture = image instanceof VideoFrame ? new VideoFrameTexture() : new Texture();
      this.texture.colorSpace = SRGBColorSpace;
      this.texture.minFilter = this.texture.magFilter = LinearFilter;
      this.texture.generateMipmaps = false;
      // Turned over by its coordinates: turning every picture over on its way to the texture costs a copy.
      this.texture.flipY = false;
      this.texture.repeat.y = -1;
      this.texture.offset.y = 1;
      this.whole.map = this.texture;
      this.whole.color.set(0xffffff);
      this.whole.needsUpdate = true;
    }
    this.texture.image = image;
    this.texture.needsUpdate = true;
  }

  /** Bars along the horizon: the closer, the higher and the more orange; grey where the lidar is blind. */
  drawScan(scan: Scan | undefined, blind: [number, number]): void {
    const places: number[] = [];
    const colors: number[] = [];
    const bar = (yaw: number, height: number, color: Color): void => {
      for (const pitch of [RING_PITCH - height, RING_PITCH + height]) {
        places.push(...point(yaw, pitch, RING_M).toArray());
        colors.push(color.r, color.g, color.b);
      }
    };
    for (const [index, cm] of (scan?.cm ?? []).entries()) {
      if (cm === 0) continue;
      const near = 1 - Math.min(Math.max((cm / 100 - RING_NEAR_M) / (RING_FAR_M - RING_NEAR_M), 0), 1);
      const yaw = scan!.first + (index + 0.5) * scan!.step;
      bar(yaw, radians(0.3 + 2.5 * near * near), FAR_COLOR.clone().lerp(NEAR_COLOR, near));
    }
    const width = (wrap(blind[1] - blind[0]) + TAU) % TAU;
    for (let step = 0; step * HATCH < width; step++) bar(blind[0] + step * HATCH, radians(step % 3 ? 0.2 : 1.6), BLIND_COLOR);
    this.changed = true;
    this.ring.geometry.setAttribute("position", new Float32BufferAttribute(places, 3));
    this.ring.geometry.setAttribute("color", new Float32BufferAttribute(colors, 3));
  }

  set ringVisible(visible: boolean) {
    this.ring.visible = visible;
    this.changed = true;
  }

  drawBoxes(boxes: Box[], all: boolean): void {
    const key = JSON.stringify([boxes, all]);
    if (key === this.boxesDrawn) return;
    this.boxesDrawn = key;
    this.changed = true;
    for (const child of [...this.boxes.children] as Mesh<BufferGeometry>[]) {
      child.geometry.dispose();
      this.boxes.remove(child);
    }
    for (const box of boxes) {
      if (!box.target && !all) continue;
      const material = box.target ? TARGET_MATERIAL : OTHER_MATERIAL;
      this.boxes.add(new Mesh(frameOf(box), material));
    }
  }
}

const TARGET_MATERIAL = new MeshBasicMaterial({ color: TARGET_COLOR, side: DoubleSide, depthTest: false });
const OTHER_MATERIAL = new MeshBasicMaterial({ color: OTHER_COLOR, side: DoubleSide, depthTest: false });

function kind(image: Picture["image"]): string {
  return image instanceof VideoFrame ? "frame" : image instanceof Planes ? "planes" : "still";
}

/** A frame of four thin strips around a box of directions; what is in it, however small, stays in sight. */
function frameOf(box: Box): BufferGeometry {
  const [left, right] = [box.yaw + box.width / 2, box.yaw - box.width / 2];
  const [top, bottom] = [box.pitch + box.height / 2, box.pitch - box.height / 2];
  const t = BOX_WIDTH;
  const strips = [
    [left + t, right - t, top + t, top],
    [left + t, right - t, bottom, bottom - t],
    [left + t, left, top, bottom],
    [right, right - t, top, bottom],
  ] as const;
  const places: number[] = [];
  for (const [from, to, high, low] of strips) {
    const corners = [point(from, high, BOX_M), point(to, high, BOX_M), point(to, low, BOX_M), point(from, low, BOX_M)];
    for (const corner of [0, 1, 2, 0, 2, 3]) places.push(...corners[corner]!.toArray());
  }
  return new BufferGeometry().setAttribute("position", new Float32BufferAttribute(places, 3));
}
