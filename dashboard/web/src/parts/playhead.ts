// SPDX-License-Identifier: Apache-2.0
// Where an episode is looked at. It lives outside the components: a tick of time moves marks, it renders nothing anew.

export class Playhead {
  step = 0;
  playing = false;
  /** Times the pace of the robot. */
  speed = 1;
  private readonly listeners = new Set<(step: number) => void>();
  private frame = 0;
  private before = 0;
  private exact = 0;

  constructor(readonly steps: number, readonly rate_hz: number) {}

  /** `listener` is called at once and on each change; the answer ends that. */
  follow(listener: (step: number) => void): () => void {
    this.listeners.add(listener);
    listener(this.step);
    return () => this.listeners.delete(listener);
  }

  seek(step: number): void {
    this.exact = Math.max(0, Math.min(this.steps - 1, step));
    this.step = Math.round(this.exact);
    for (const listener of this.listeners) listener(this.step);
  }

  play(on: boolean): void {
    if (on === this.playing) return;
    this.playing = on;
    cancelAnimationFrame(this.frame);
    if (on) {
      if (this.step >= this.steps - 1) this.seek(0);
      this.before = performance.now();
      this.frame = requestAnimationFrame(this.tick);
    }
    for (const listener of this.listeners) listener(this.step);
  }

  private readonly tick = (time: number) => {
    this.seek(this.exact + ((time - this.before) / 1000) * this.rate_hz * this.speed);
    this.before = time;
    if (this.step >= this.steps - 1) this.play(false);
    else if (this.playing) this.frame = requestAnimationFrame(this.tick);
  };

  stop(): void {
    this.play(false);
    this.listeners.clear();
  }
}
