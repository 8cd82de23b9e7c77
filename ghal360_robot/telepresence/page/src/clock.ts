/** The robot's clock as seen from here: the fastest of the last round trips says best how far off ours is. */

const SAMPLES = 20;

interface Sample {
  roundTripMs: number;
  offsetUs: number;
}

export class RobotClock {
  /** Called with every round trip. */
  onRoundTrip: (ms: number) => void = () => undefined;
  private samples: Sample[] = [];

  /** One answered ping: our `performance.now()` before and after, the robot's microseconds in between. */
  note(t0: number, receivedUs: number, sentUs: number, t3: number): void {
    const roundTripMs = t3 - t0 - (sentUs - receivedUs) / 1000;
    const offsetUs = (receivedUs + sentUs) / 2 - ((t0 + t3) / 2) * 1000;
    this.onRoundTrip(roundTripMs);
    this.samples = [...this.samples.slice(1 - SAMPLES), { roundTripMs, offsetUs }];
  }

  /** A new connection may be to a robot that was started anew. */
  forget(): void {
    this.samples = [];
  }

  get known(): boolean {
    return this.samples.length > 0;
  }

  /** Microseconds of the robot's clock; 0 before it is known. */
  nowUs(): number {
    const best = this.best;
    return best === undefined ? 0 : Math.max(0, Math.round(performance.now() * 1000 + best.offsetUs));
  }

  get roundTripMs(): number | undefined {
    const ordered = this.samples.map((sample) => sample.roundTripMs).sort((a, b) => a - b);
    return ordered[ordered.length >> 1];
  }

  private get best(): Sample | undefined {
    return this.samples.reduce<Sample | undefined>(
      (best, sample) => (best === undefined || sample.roundTripMs < best.roundTripMs ? sample : best),
      undefined,
    );
  }
}
