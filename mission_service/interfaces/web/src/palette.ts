// Colours that have a meaning on the map. Within each group they differ also for people with deuteranopia
// (tests/web/test_palette.py).

export const PALETTE = {
  pens: {
    burned: "#5a1a00", burning: "#d40000", unburned: "#0277bd", closed: "#4a148c", measure: "#111111", note: "#00695c",
  },
  missions: { onBoard: "#0b3d91", sending: "#8a5a00", proposed: "#ad1457" },
  vehicles: { online: "#111111", lost: "#c40000", chosen: "#0b3d91" },
  aircraft: { none: "#455a64", preventive: "#7a6a2a", corrective: "#d84315", warning: "#7a0000" },
  arrival: { none: "#455a64", warning: "#c25100", severe: "#7a0000" },
  fire: { now: "#8b0000", then: "#c25100", preview: "#0b57d0" },
} as const;
