// Beeps by WebAudio, without files. Browsers permit sound only after the first touch or key press.

import type { Level } from "./types.ts";

let context: AudioContext | null = null;

/** Enable sound at the next touch or key press, then call `changed`. */
export function readySound(changed: () => void): void {
  const wake = (): void => {
    context ??= new AudioContext();
    void context.resume().then(changed);
  };
  for (const kind of ["pointerdown", "keydown"]) addEventListener(kind, wake, { capture: true });
}

export const canSound = (): boolean => context?.state === "running";

const BEEPS: Record<Level, { hertz: number; times: number }> = {
  info: { hertz: 660, times: 1 },
  warning: { hertz: 780, times: 2 },
  severe: { hertz: 960, times: 4 },
};

/** Play the sound of an alarm of this level once. */
export function beep(level: Level): void {
  if (context === null || !canSound()) return;
  const { hertz, times } = BEEPS[level];
  for (let i = 0; i < times; i++) {
    const begin = context.currentTime + i * 0.22;
    const tone = context.createOscillator();
    const loudness = context.createGain();
    tone.type = "square";
    tone.frequency.value = hertz;
    loudness.gain.setValueAtTime(0.0001, begin);
    loudness.gain.exponentialRampToValueAtTime(0.25, begin + 0.02);
    loudness.gain.setValueAtTime(0.25, begin + 0.12);
    loudness.gain.exponentialRampToValueAtTime(0.0001, begin + 0.16);
    tone.connect(loudness).connect(context.destination);
    tone.start(begin);
    tone.stop(begin + 0.18);
  }
}
