import { defineConfig } from "vite";

// Relative addresses: the page works behind a proxy's path too. Nothing is inlined, so that the
// page's content security policy needs no exceptions.
export default defineConfig({
  base: "./",
  build: {
    target: "es2022",
    assetsInlineLimit: 0,
    chunkSizeWarningLimit: 2000,
    modulePreload: { polyfill: false },
  },
  worker: { format: "es" },
});
