/** The little of A-Frame that this page uses. */
declare module "aframe" {
  import type { Camera, Object3D, Scene, WebGLRenderer } from "three";

  export interface AScene extends HTMLElement {
    object3D: Scene;
    camera: Camera;
    renderer: WebGLRenderer;
    hasLoaded: boolean;
    canvas: HTMLCanvasElement;
    enterVR(): Promise<void>;
    exitVR(): Promise<void>;
    is(state: string): boolean;
  }

  export interface AEntity extends HTMLElement {
    object3D: Object3D;
    sceneEl: AScene;
    setObject3D(name: string, object: Object3D): void;
  }

  interface Component {
    el: AEntity;
    init?(): void;
    tick?(timeMs: number, elapsedMs: number): void;
  }

  const AFRAME: {
    version: string;
    registerComponent(name: string, definition: ThisType<Component & Record<string, unknown>> & Partial<Component>): void;
  };
  export default AFRAME;
}
