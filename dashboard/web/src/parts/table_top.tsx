// SPDX-License-Identifier: Apache-2.0
// The table from above, as the camera stands before it: right is -x of the world, towards the camera is down.
import { useRef, useState } from 'preact/hooks';

export interface Standing { name: string; x: number; y: number; z: number; yaw: number; half_extent: number[]; hidden: boolean }

interface Drag { name: string; x: number; y: number; fromX: number; fromY: number }
interface Place { x: number; y: number }

/** Moves an object; false: it was refused. */
type Move = (name: string, x: number, y: number) => Promise<boolean>;

// ms after the answer until the state that is told says so, too
const toldAfter = 1000;

/** Where objects were put. One request at a time: of a key that repeats the newest place is sent when the one before was answered. */
function useWishes(move: Move | null): { wished: (name: string) => Place | undefined; wish: (name: string, place: Place) => void } {
  const [, redraw] = useState({});
  const all = useRef(new Map<string, Place>());
  const sent = useRef(new Map<string, Place>());
  const sending = useRef(false);
  const latest = useRef(move);
  latest.current = move;
  const forget = (name: string, place: Place) => {
    if (all.current.get(name) !== place) return;
    all.current.delete(name);
    redraw({});
  };
  const send = async () => {
    if (sending.current) return;
    sending.current = true;
    for (;;) {
      const due = [...all.current].find(([name, place]) => sent.current.get(name) !== place);
      if (!due) break;
      const [name, place] = due;
      sent.current.set(name, place);
      const done = await (latest.current?.(name, place.x, place.y) ?? false);
      if (done) window.setTimeout(() => forget(name, place), toldAfter);
      else forget(name, place);
    }
    sending.current = false;
  };
  const wish = (name: string, place: Place) => {
    all.current.set(name, place);
    redraw({});
    void send();
  };
  return { wished: (name) => all.current.get(name), wish };
}

export function TableTop(props: { half: number; objects: Standing[]; selected: string; select: (name: string) => void; move: Move | null }) {
  const { half } = props;
  const { wished, wish } = useWishes(props.move);
  const placeOf = (object: Standing): Place => wished(object.name) ?? object;
  const svg = useRef<SVGSVGElement>(null);
  const [drag, setDrag] = useState<Drag | null>(null);
  const at = (event: PointerEvent): [number, number] => {
    const box = svg.current!.getBoundingClientRect();
    return [-(((event.clientX - box.left) / box.width) * 2 - 1) * half, (((event.clientY - box.top) / box.height) * 2 - 1) * half];
  };
  const down = (event: PointerEvent, object: Standing) => {
    props.select(object.name);
    if (!props.move) return;
    const [x, y] = at(event);
    const from = placeOf(object);
    setDrag({ name: object.name, x: from.x, y: from.y, fromX: x - from.x, fromY: y - from.y });
    svg.current!.setPointerCapture(event.pointerId);
  };
  const over = (event: PointerEvent) => {
    if (!drag) return;
    const [x, y] = at(event);
    setDrag({ ...drag, x: x - drag.fromX, y: y - drag.fromY });
  };
  const up = () => {
    if (!drag) return;
    const object = props.objects.find((one) => one.name === drag.name);
    setDrag(null);
    if (object && Math.hypot(placeOf(object).x - drag.x, placeOf(object).y - drag.y) > 0.005) wish(drag.name, { x: drag.x, y: drag.y });
  };
  const step = (event: KeyboardEvent, object: Standing) => {
    const by = { ArrowLeft: [0.01, 0], ArrowRight: [-0.01, 0], ArrowUp: [0, -0.01], ArrowDown: [0, 0.01] }[event.key];
    if (event.key === 'Enter' || event.key === ' ') props.select(object.name);
    else if (by && props.move) {
      const from = placeOf(object);
      wish(object.name, { x: from.x + by[0]!, y: from.y + by[1]! });
    } else return;
    event.preventDefault();
  };
  return (
    <svg ref={svg} class="table-top" viewBox={`${-half} ${-half} ${2 * half} ${2 * half}`} role="group" aria-label="The table from above" onPointerMove={over} onPointerUp={up} onPointerCancel={() => setDrag(null)}>
      <rect class="edge" x={-half} y={-half} width={2 * half} height={2 * half} />
      {props.objects.map((object) => {
        const place = drag?.name === object.name ? drag : placeOf(object);
        const [w, h] = [object.half_extent[0] ?? 0.03, object.half_extent[1] ?? 0.03];
        return (
          <g transform={`translate(${-place.x} ${place.y}) rotate(${(-object.yaw * 180) / Math.PI})`} class={`standing${object.hidden ? ' hidden' : ''}${object.name === props.selected ? ' selected' : ''}`}
            role="button" tabindex={0} aria-label={`${object.name}${object.hidden ? ', hidden' : ''}`} aria-pressed={object.name === props.selected} data-arrows data-object={object.name}
            onPointerDown={(event) => down(event, object)} onKeyDown={(event) => step(event, object)}>
            <rect x={-w} y={-h} width={2 * w} height={2 * h} />
            <text y={h + 0.05} transform={`rotate(${(object.yaw * 180) / Math.PI})`}>{object.name}</text>
          </g>
        );
      })}
    </svg>
  );
}
