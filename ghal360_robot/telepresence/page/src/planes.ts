/** Pictures decoded in software, as they lie in memory: three planes of luma and chroma, turned into colours where they
are drawn. A browser without a GPU that is handed the picture as a whole turns all of it into colours first, which costs
it more than decoding and drawing together. */

import { BackSide, DataTexture, LinearFilter, Matrix3, RedFormat, ShaderMaterial, UnsignedByteType, Vector3 } from "three";

/** Buffers kept for the next pictures: one drawn, one waiting, one being filled. */
const MOST_FREE = 3;
const HD_HEIGHT = 720;

const free: ArrayBuffer[] = [];

/** One picture in 4:2:0; whoever takes it has to close it. */
export class Planes {
  private constructor(
    private readonly buffer: ArrayBuffer,
    private readonly layout: PlaneLayout[],
    readonly width: number,
    readonly height: number,
    readonly colors: VideoColorSpace,
  ) {}

  /** Whether a frame lies in memory like that; one in a GPU has to stay there. */
  static fit(frame: VideoFrame): boolean {
    return frame.format === "I420";
  }

  /** Copies the frame, and closes it. */
  static async of(frame: VideoFrame): Promise<Planes> {
    const size = frame.allocationSize();
    const last = free.pop();
    const buffer = last?.byteLength === size ? last : new ArrayBuffer(size);
    const { width, height } = frame.visibleRect!;
    const { colorSpace } = frame;
    try {
      return new Planes(buffer, await frame.copyTo(buffer), width, height, colorSpace);
    } finally {
      frame.close();
    }
  }

  close(): void {
    if (free.length < MOST_FREE) free.push(this.buffer);
  }

  /** Luma, blue and red, row by row. */
  plane(which: number): { data: Uint8Array<ArrayBuffer>; width: number; height: number } {
    const { offset, stride } = this.layout[which]!;
    const height = which === 0 ? this.height : Math.ceil(this.height / 2);
    return { data: new Uint8Array(this.buffer, offset, stride * height), width: stride, height };
  }
}

/** Draws planes on the inside of a sphere. */
export class PlanesMaterial extends ShaderMaterial {
  private readonly textures = [planeTexture(), planeTexture(), planeTexture()];
  private size = "";

  constructor() {
    super({
      side: BackSide,
      uniforms: { toColor: { value: new Matrix3() }, zero: { value: new Vector3() } },
      vertexShader: "varying vec2 at; void main() { at = vec2(uv.x, 1.0 - uv.y); gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }",
      fragmentShader: `
        uniform sampler2D luma, blue, red;
        uniform mat3 toColor;
        uniform vec3 zero;
        varying vec2 at;
        void main() {
          vec3 parts = vec3(texture2D(luma, at).r, texture2D(blue, at).r, texture2D(red, at).r);
          gl_FragColor = vec4(toColor * (parts - zero), 1.0);
        }`,
    });
    for (const [which, name] of ["luma", "blue", "red"].entries()) {
      this.uniforms[name] = { value: this.textures[which] };
    }
  }

  show(picture: Planes): void {
    const size = `${picture.width}x${picture.height}`;
    for (const [which, texture] of this.textures.entries()) {
      if (size !== this.size) texture.dispose(); // the next upload makes one of the right size
      texture.image = picture.plane(which);
      texture.needsUpdate = true;
    }
    this.size = size;
    const { toColor, zero } = conversion(picture);
    (this.uniforms["toColor"]!.value as Matrix3).copy(toColor);
    (this.uniforms["zero"]!.value as Vector3).copy(zero);
  }
}

function planeTexture(): DataTexture {
  const texture = new DataTexture(null, 1, 1, RedFormat, UnsignedByteType);
  texture.minFilter = texture.magFilter = LinearFilter;
  return texture;
}

/** From what lies in memory to colours (ITU-R BT.601 and BT.709); what a stream does not say goes by its height. */
function conversion(picture: Planes): { toColor: Matrix3; zero: Vector3 } {
  const { matrix, fullRange } = picture.colors;
  const sd = matrix === null ? picture.height < HD_HEIGHT : matrix === "smpte170m" || matrix === "bt470bg";
  const [red, blue] = sd ? [0.299, 0.114] : [0.2126, 0.0722];
  const green = 1 - red - blue;
  const [luma, chroma] = fullRange ? [1, 1] : [255 / 219, 255 / 224];
  const [toRed, toBlue] = [2 * (1 - red) * chroma, 2 * (1 - blue) * chroma];
  const toColor = new Matrix3().set(
    luma, 0, toRed,
    luma, (-toBlue * blue) / green, (-toRed * red) / green,
    luma, toBlue, 0,
  );
  return { toColor, zero: new Vector3(fullRange ? 0 : 16 / 255, 128 / 255, 128 / 255) };
}
