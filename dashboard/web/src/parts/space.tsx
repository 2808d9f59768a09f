// SPDX-License-Identifier: Apache-2.0
// The 3D view's place on a page: loads three.js when seen, and shows the same from above where there is no WebGL.
import { useEffect, useRef, useState } from 'preact/hooks';
import { useKeys } from '../core/keys';
import { paints } from '../core/theme';
import type { Playhead } from './playhead';
import type { ReplayFiles } from './replay';

export interface SpaceData {
  /** (steps, 3) m. */
  tool: Float32Array;
  paths: { points: Float32Array; token: string; dashed: boolean }[];
  /** Pose: (steps, 7), position m then quaternion. */
  objects: { name: string; token: string; pose: Float32Array }[];
  camera: { position: number[]; quaternion_wxyz: number[]; fovy_rad: number } | null;
  /** Shapes of all bodies and where they were; null: objects are balls at their places. */
  replay: { files: ReplayFiles; token: (body: string) => string } | null;
}

export interface SpaceView { seek: (step: number) => void; view: (name: 'camera' | 'top' | 'side') => void; dispose: () => void }

/** `keys`: false where the digits are the page's own. */
export function Space(props: { data: SpaceData; playhead: Playhead; keys?: boolean; label?: string }) {
  const host = useRef<HTMLDivElement>(null);
  const labels = useRef<HTMLDivElement>(null);
  const current = useRef<SpaceView | null>(null);
  const [asked, setAsked] = useState(() => window.matchMedia('(min-width: 640px)').matches);
  const [flat, setFlat] = useState(false);
  const paint = paints.value;
  useEffect(() => {
    if (!asked || flat) return;
    let gone = false;
    let stop = () => {};
    import('./view3d').then(({ mount }) => {
      if (gone || !host.current || !labels.current) return;
      current.current = mount(host.current, labels.current, props.data);
      stop = props.playhead.follow((step) => current.current?.seek(step)) as () => void;
    }).catch(() => setFlat(true));
    return () => {
      gone = true;
      stop();
      current.current?.dispose();
      current.current = null;
    };
  }, [asked, flat, props.data, props.playhead, paint]);
  const views = [['1', 'camera'], ['2', 'top'], ['3', 'side']] as const;
  useKeys(props.keys === false ? [] : [...views, ['0', 'camera'] as const].map(([keys, name]) => ({ keys, does: `3D from ${name}`, run: () => current.current?.view(name) })));
  if (flat) return <TopView data={props.data} playhead={props.playhead} />;
  return (
    <div class={`view3d${asked ? '' : ' closed'}`} ref={host} role="group" aria-label={props.label ?? `3D view: tool path, ${props.data.replay ? 'robot, objects' : 'objects'} and camera`}>
      <div class="labels" ref={labels} aria-hidden="true" />
      {asked
        ? <div class="keys">{views.map(([, name]) => <button type="button" class="button" onClick={() => current.current?.view(name)}>{name}</button>)}</div>
        : <div class="keys"><button type="button" class="button" onClick={() => setAsked(true)}>Show in 3D</button></div>}
    </div>
  );
}

/** From above, x to the left as the camera sees it. */
function TopView(props: { data: SpaceData; playhead: Playhead }) {
  const tool = useRef<SVGCircleElement>(null);
  const dots = useRef<(SVGCircleElement | null)[]>([]);
  const at = (x: number, y: number) => [100 - 200 * x, 200 * y] as const;
  useEffect(() => props.playhead.follow((step) => {
    const [x, y] = at(props.data.tool[3 * step]!, props.data.tool[3 * step + 1]!);
    tool.current?.setAttribute('cx', String(x));
    tool.current?.setAttribute('cy', String(y));
    props.data.objects.forEach((object, i) => {
      const [u, v] = at(object.pose[7 * step]!, object.pose[7 * step + 1]!);
      dots.current[i]?.setAttribute('cx', String(u));
      dots.current[i]?.setAttribute('cy', String(v));
    });
  }) as () => void, [props.data, props.playhead]);
  return (
    <div class="view3d"><svg viewBox="0 -20 200 140" width="100%" role="img" aria-label="Top view: tool path and objects">
      {props.data.paths.map((path) => <polyline fill="none" stroke={`var(--${path.token})`} stroke-width="0.8" {...(path.dashed ? { 'stroke-dasharray': '2 2' } : {})} points={Array.from({ length: path.points.length / 3 }, (_one, i) => at(path.points[3 * i]!, path.points[3 * i + 1]!).join()).join(' ')} />)}
      {props.data.objects.map((object, i) => <circle ref={(element: SVGCircleElement | null) => { dots.current[i] = element; }} r="4" fill={`var(--${object.token})`}><title>{object.name}</title></circle>)}
      <circle ref={tool} r="3" fill="var(--hand)" />
    </svg></div>
  );
}
