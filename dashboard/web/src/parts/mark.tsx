// SPDX-License-Identifier: Apache-2.0
// A cross or a ring over a picture, in its dark-theme colour between black and white.

export type Glyph = 'ring' | 'cross';

/** What a mark is drawn of, about the origin of the group that it stands in (class mark). */
export function MarkLayers(props: { token: string; glyph: Glyph }) {
  return (
    <>
      {(['casing', 'line', 'hair'] as const).map((layer) => props.glyph === 'ring'
        ? <circle class={`${layer} ${props.token}`} r="5" />
        : <path class={`${layer} ${props.token}`} d="M-6 0H-2M2 0H6M0 -6V-2M0 2V6" />)}
    </>
  );
}

/** At a pixel. */
export function PixelMark(props: { token: string; glyph: Glyph; at: readonly number[] }) {
  return <g class="mark" data-mark={props.token} transform={`translate(${props.at[0] ?? 0} ${props.at[1] ?? 0})`}><MarkLayers token={props.token} glyph={props.glyph} /></g>;
}
