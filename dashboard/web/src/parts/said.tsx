// SPDX-License-Identifier: Apache-2.0
// What a policy saw in a recorded picture and said of it, whether its server was asked or a file has it: the picture,
// where a module attends, and a table of what all of them say.
import type { ComponentChildren } from 'preact';
import { useMemo } from 'preact/hooks';
import { root } from '../core/api';
import { none, number } from '../core/format';
import { linkHere, parameter } from '../core/router';
import { difference, errorText, plan, truthText, words } from '../core/says';
import { moduleColor } from '../core/theme';
import type { Episode, Insight } from '../core/types';
import { AttentionBars, HeadSelect, lookOf } from './attention';
import { PixelMark } from './mark';
import { Spotlight } from './spotlight';

/** With where `module` looks as light; `children` lays the marks over it, what it says and what is true. */
export function Seen(props: { episode: Episode; picture: number; module: string; of: Insight | undefined; children: (marks: ComponentChildren) => ComponentChildren }) {
  const { episode, of } = props;
  const camera = episode.cameras[0]!;
  const [head] = parameter('head');
  const attention = of?.attention[props.module];
  const look = useMemo(() => attention && lookOf(attention, head), [attention, head]);
  const truth = of ? of.truth.pixels[of.truth.target] : undefined;
  const pixel = of?.modules[props.module]?.soft_argmax;
  return (
    <div class="picture" style={{ aspectRatio: `${camera.width_px} / ${camera.height_px}` }}>
      <img src={`${root}/datasets/${episode.dataset}/episodes/${episode.index}/pictures/${encodeURIComponent(camera.name)}/${props.picture}.png`} alt={`Picture ${props.picture + 1} of episode ${episode.index}`} draggable={false} />
      {of && look && look.rows > 0 && <Spotlight module={props.module} attention={look} view={of.view} width={camera.width_px} height={camera.height_px} />}
      {props.children(<>
        {truth && <PixelMark token="target" glyph="ring" at={truth} />}
        {pixel && <PixelMark token="hand" glyph="cross" at={pixel} />}
      </>)}
    </div>
  );
}

export function Attends(props: { of: Insight; module: string }) {
  const [head, setHead] = parameter('head');
  const attention = props.of.attention[props.module];
  if (!attention) return null;
  return (
    <>
      <HeadSelect attention={attention} head={head} choose={(one) => setHead(one, true)} />
      <AttentionBars module={props.module} attention={attention} head={head} linkTo={(module) => linkHere({ module })} />
    </>
  );
}

export function Said(props: { of: Insight; module: string; planner: string }) {
  const { of } = props;
  const planned = plan(of);
  const asked = of.what_if !== null;
  return (
    <div class="scroll-x" tabIndex={0} role="group" aria-label="What the modules say">
      <table class="plain" data-said>
        <thead><tr><th>module</th><th>says</th><th>is</th><th class="num">error</th>{asked && <><th>would say</th><th class="num">Δ</th></>}<th class="num">looks at picture</th></tr></thead>
        <tbody>{Object.entries(of.modules).map(([name, one]) => {
          const plans = name === props.planner;
          const error = of.truth.errors[name];
          return (
            <tr data-module={name} {...(name === props.module ? { 'aria-selected': 'true' as const } : {})}>
              <td class="nowrap"><a href={linkHere({ module: name })}><span class="swatch" style={{ background: `var(--${moduleColor(name)})` }} /> {name}</a></td>
              <td>{plans ? planned.says : words(one)}</td>
              <td class="secondary">{plans ? (of.truth.waypoints.length ? `${of.truth.waypoints.length} demonstrated` : none) : truthText(error)}</td>
              <td class="num nowrap" data-error>{(plans ? planned.error : errorText(error)) || none}</td>
              {asked && <><td data-would>{plans ? `${of.what_if_waypoints.length || none} waypoints` : words(of.what_if?.[name])}</td><td class="num nowrap" data-change>{plans ? planned.change : difference(one, of.what_if?.[name])}</td></>}
              <td class="num">{of.attention[name]?.rows ? number(of.attention[name]!.share, 2) : none}</td>
            </tr>);
        })}
        </tbody>
      </table>
    </div>
  );
}
