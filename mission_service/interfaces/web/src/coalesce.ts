// Limit for jobs that are requested more often than they can run.

/**
 * Return a function that requests `job`. One job runs at a time, with a pause of at least `minMs`
 * after it; requests during this time cause one more run. A failed job is not repeated.
 */
export function coalesced(job: () => Promise<void>, minMs: number): () => void {
  let running = false;
  let requested = false;
  const run = async (): Promise<void> => {
    running = true;
    while (requested) {
      requested = false;
      await job().catch((error: unknown) => console.info("job failed:", String(error)));
      await new Promise((done) => setTimeout(done, minMs));
    }
    running = false;
  };
  return () => {
    requested = true;
    if (!running) void run();
  };
}
