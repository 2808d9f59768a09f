// SPDX-License-Identifier: Apache-2.0
// The waypoints that a policy plans, in space: beside those that were demonstrated, those of the what-if, where the
// modules take the hand and the target to be, and where they are.
import { useMemo } from 'preact/hooks';
import { number } from '../core/format';
import { moduleColor } from '../core/theme';
import type { Episode, Insight } from '../core/types';
import { Playhead } from './playhead';
import { Space, type SpaceData } from './space';

const still = new Playhead(1, 1);  // one moment

const placesOf = (points: number[][]) => Float32Array.from(points.flatMap((one) => one.slice(0, 3)));
const poseAt = (place: readonly number[]) => Float32Array.from([place[0]!, place[1]!, place[2]!, 1, 0, 0, 0]);

/** Where modules say that something is, of the what-if where there is one. */
function said(of: Insight): { module: string; place: number[] }[] {
  return Object.entries(of.what_if ?? of.modules).flatMap(([module, one]) => (one.quantity === 'position' || one.quantity === 'pose') && Array.isArray(one.value) && one.value.every((part) => typeof part === 'number') && one.value.length >= 3
    ? [{ module, place: one.value.slice(0, 3) as number[] }] : []);
}

export function spaceOf(episode: Episode, of: Insight): SpaceData | null {
  const hand = of.truth.positions['hand'];
  if (!hand) return null;
  const lines = [[of.truth.waypoints, 'muted', true], [of.waypoints, 'accent', false], [of.what_if_waypoints, 'warn', true]] as const;
  const things = Object.entries(of.truth.positions).filter(([name]) => name !== 'hand').map(([name, place]) => ({ name, token: name === of.truth.target ? 'target' : name === of.truth.reference ? 'reference' : 'muted', pose: poseAt(place) }));
  const camera = episode.cameras[0];
  return {
    tool: Float32Array.from(hand),
    paths: lines.filter(([points]) => points.length > 1).map(([points, token, dashed]) => ({ points: placesOf(points), token, dashed })),
    objects: [...things, ...said(of).map(({ module, place }) => ({ name: module, token: moduleColor(module), pose: poseAt(place) }))],
    camera: camera ? { position: camera.position_m, quaternion_wxyz: camera.quaternion_wxyz, fovy_rad: camera.fovy_rad } : null,
    replay: null,
  };
}

export function PlanInSpace(props: { episode: Episode; of: Insight }) {
  const { of } = props;
  // the same scene is not built anew because another module is looked at
  const data = useMemo(() => spaceOf(props.episode, of), [props.episode, of]);
  if (!data) return null;
  const rows = [['planned', of.waypoints, 'accent', ''], ['with the what-if', of.what_if_waypoints, 'warn', '4 3'], ['demonstrated', of.truth.waypoints, 'muted', '4 3']] as const;
  const there = rows.filter(([, points]) => points.length > 0);
  return (
    <div class="stack" data-plan>
      <Space data={data} playhead={still} keys={false} label="3D view: planned waypoints, hand and objects" />
      <p class="row wrap small muted">{there.map(([name, , token, dash]) => (
        <span class="row nowrap"><svg width="26" height="8" aria-hidden="true"><line x1="0" x2="26" y1="4" y2="4" stroke={`var(--${token})`} stroke-width="2" {...(dash ? { 'stroke-dasharray': dash } : {})} /></svg>{name}</span>))}
        <span>waypoints; balls with a module's name are where it says that its object is</span></p>
      <div class="sr"><table data-waypoints><caption>Waypoints, m</caption><tbody>{there.map(([name, points]) => <tr><th scope="row">{name}</th>{points.map((one) => <td>{one.slice(0, 3).map((part) => number(part, 4)).join(' ')}</td>)}</tr>)}</tbody></table></div>
    </div>
  );
}
