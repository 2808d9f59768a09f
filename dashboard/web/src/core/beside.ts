// SPDX-License-Identifier: Apache-2.0
// From one point to the next by arrow keys.

/** The nearest point from number `at` that lies that way rather than another; `at` itself where there is none. */
export function beside(x: ArrayLike<number>, y: ArrayLike<number>, at: number, way: readonly [number, number]): number {
  let best = at;
  let least = Infinity;
  for (let i = 0; i < x.length; i++) {
    const [ax, ay] = [x[i]! - x[at]!, y[i]! - y[at]!];
    const along = ax * way[0] + ay * way[1];
    const across = Math.abs(ax * way[1] - ay * way[0]);
    if (i === at || along <= 0 || across > along || along + across >= least) continue;
    least = along + across;
    best = i;
  }
  return best;
}
