import { defineConfig } from "vite";

// Served by the robot from its own origin: every file next to the page, nothing from a CDN, nothing inline.
export default defineConfig({
  base: "/",
  build: {
    target: "es2022",
    outDir: "dist",
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 2500,
    rolldownOptions: { output: { comments: false } },
  },
});
