// SPDX-License-Identifier: Apache-2.0
// A picture of which parts can be hidden: dragged over with the pointer, or with a brush that the keyboard moves.
import type { ComponentChildren } from 'preact';
import { useRef, useState } from 'preact/hooks';
import { moved, type Rectangle } from '../core/rectangles';

function between(from: [number, number], to: [number, number]): Rectangle {
  return [Math.round(Math.min(from[0], to[0])), Math.round(Math.min(from[1], to[1])), Math.round(Math.abs(from[0] - to[0])), Math.round(Math.abs(from[1] - to[1]))];
}

/** Lies over a picture of `width` by `height` px; its children are marks, in px. */
export function Mask(props: { width: number; height: number; view: { u: number; v: number; width: number; height: number } | undefined; hidden: Rectangle[]; change: (hidden: Rectangle[]) => void; children?: ComponentChildren }) {
  const { width, height, hidden } = props;
  const svg = useRef<SVGSVGElement>(null);
  const [drag, setDrag] = useState<{ from: [number, number]; to: [number, number] } | null>(null);
  const [brush, setBrush] = useState<Rectangle | null>(null);
  const at = (event: PointerEvent): [number, number] => {
    const box = svg.current!.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * width, ((event.clientY - box.top) / box.height) * height];
  };
  // in the middle of what the policy sees, where hiding something means something
  const start = (): Rectangle => {
    const view = props.view?.width ? props.view : { u: 0, v: 0, width, height };
    return [Math.round(view.u + view.width / 2 - 8), Math.round(view.v + view.height / 2 - 8), 16, 16];
  };
  const press = (event: KeyboardEvent) => {
    const now = brush ?? start();
    const next = moved(now, event.key, event.shiftKey, { width, height });
    if (next) setBrush(next);
    else if (event.key === 'Enter' || event.key === ' ') props.change([...hidden, now]);
    else if (event.key === 'Backspace' || event.key === 'Delete') props.change(hidden.slice(0, -1));
    else return;
    if (!brush) setBrush(next ?? now);
    event.preventDefault();
  };
  const dropped = () => {
    const one = drag && between(drag.from, drag.to);
    if (one && one[2] > 2 && one[3] > 2) props.change([...hidden, one]);
    setDrag(null);
  };
  return (
    <svg ref={svg} viewBox={`0 0 ${width} ${height}`} class="hide-brush" role="group" tabindex={0} data-arrows data-hidden={hidden.length}
      aria-label="Hide a part of the picture: arrow keys move the brush, with Shift they size it, Enter hides what is under it, Backspace shows the last part again"
      onFocus={(event) => { if (event.currentTarget.matches(':focus-visible')) setBrush(brush ?? start()); }} onBlur={() => setBrush(null)} onKeyDown={press}
      onPointerDown={(event) => { event.currentTarget.setPointerCapture(event.pointerId); setDrag({ from: at(event), to: at(event) }); }}
      onPointerMove={(event) => { if (drag) setDrag({ ...drag, to: at(event) }); }} onPointerUp={dropped}>
      {[...hidden, ...(drag ? [between(drag.from, drag.to)] : [])].map(([x, y, w, h]) => <rect class="hidden-part" x={x} y={y} width={w} height={h} />)}
      {brush && <rect class="brush" x={brush[0]} y={brush[1]} width={brush[2]} height={brush[3]} data-brush={brush.join()} />}
      {props.children}
    </svg>
  );
}
