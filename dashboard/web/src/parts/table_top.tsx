// SPDX-License-Identifier: Apache-2.0
// The table from above, as the camera stands before it: right is -x of the world, towards the camera is down.
import { useRef, useState } from 'preact/hooks';

export interface Standing { name: string; x: number; y: number; z: number; yaw: number; half_extent: number[]; hidden: boolean }

interface Drag { name: string; x: number; y: number; fromX: number; fromY: number }

export function TableTop(props: { half: number; objects: Standing[]; selected: string; select: (name: string) => void; move: ((name: string, x: number, y: number) => void) | null }) {
  const { half } = props;
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
    setDrag({ name: object.name, x: object.x, y: object.y, fromX: x - object.x, fromY: y - object.y });
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
    if (object && Math.hypot(object.x - drag.x, object.y - drag.y) > 0.005) props.move?.(drag.name, drag.x, drag.y);
  };
  const step = (event: KeyboardEvent, object: Standing) => {
    const by = { ArrowLeft: [0.01, 0], ArrowRight: [-0.01, 0], ArrowUp: [0, -0.01], ArrowDown: [0, 0.01] }[event.key];
    if (event.key === 'Enter' || event.key === ' ') props.select(object.name);
    else if (by && props.move) props.move(object.name, object.x + by[0]!, object.y + by[1]!);
    else return;
    event.preventDefault();
  };
  return (
    <svg ref={svg} class="table-top" viewBox={`${-half} ${-half} ${2 * half} ${2 * half}`} role="group" aria-label="The table from above" onPointerMove={over} onPointerUp={up} onPointerCancel={() => setDrag(null)}>
      <rect class="edge" x={-half} y={-half} width={2 * half} height={2 * half} />
      {props.objects.map((object) => {
        const place = drag?.name === object.name ? drag : object;
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
