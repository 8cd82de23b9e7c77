/** Before A-Frame is loaded: it fetches nothing from anywhere but the robot. */
(globalThis as { AFRAME_CDN_ROOT?: string }).AFRAME_CDN_ROOT = "/";
