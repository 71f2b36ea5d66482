import { defineConfig } from "vite";

// Relative addresses, so that the page works below any path of a proxy. No resource is inlined, so the
// content security policy of the page needs no exceptions.
export default defineConfig({
  base: "./",
  build: {
    target: "es2022",
    assetsInlineLimit: 0,
    chunkSizeWarningLimit: 2000,
    rolldownOptions: { input: ["index.html", "incident.html"] },
    modulePreload: { polyfill: false },
  },
  worker: { format: "es" },
});
