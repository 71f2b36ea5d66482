// Jobs that are asked for more often than they can be done.

/**
 * `job` so that one runs at a time, the last asked for is always done, and none begins within
 * `leastMs` of the one before. What fails is tried again when it is asked for again.
 */
export function coalesced(job: () => Promise<void>, leastMs: number): () => void {
  let running = false;
  let wanted = false;
  const run = async (): Promise<void> => {
    running = true;
    while (wanted) {
      wanted = false;
      await job().catch((error: unknown) => console.info("not done:", String(error)));
      await new Promise((done) => setTimeout(done, leastMs));
    }
    running = false;
  };
  return () => {
    wanted = true;
    if (!running) void run();
  };
}
