// SPDX-License-Identifier: Apache-2.0
// Shapes that tell runs apart where colour does not: ● ◆ ■ ▲, in the order of the colours.

const shapes = ['M-4 0A4 4 0 1 1 4 0A4 4 0 1 1 -4 0Z', 'M0 -5L5 0L0 5L-5 0Z', 'M-3.7 -3.7H3.7V3.7H-3.7Z', 'M0 -4.6L4.6 3.6H-4.6Z'];

/** Of the run that was picked as number `of`. */
export function Marker(props: { of: number; token: string }) {
  return <svg width="12" height="12" viewBox="-6 -6 12 12" aria-hidden="true" data-marker={props.of}><path d={shapes[props.of % shapes.length]!} fill={`var(--${props.token})`} /></svg>;
}

/** Of such points of a line in px as are `apart`, and of all where that is 0; lines of other runs have theirs between. */
export function drawMarkers(context: CanvasRenderingContext2D, of: number, points: readonly (readonly [number, number])[], apart: number): void {
  const shape = new Path2D(shapes[of % shapes.length]!);
  let next = -Infinity;
  for (const [x, y] of points) {
    if (x < next) continue;
    // a quarter further for each run
    next = Number.isFinite(next) ? x + apart : x + (apart * (1 + (of % shapes.length))) / shapes.length;
    context.save();
    context.translate(x, y);
    context.scale(devicePixelRatio, devicePixelRatio);
    context.fill(shape);
    context.restore();
  }
}
