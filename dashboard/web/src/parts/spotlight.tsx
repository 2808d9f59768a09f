// SPDX-License-Identifier: Apache-2.0
// Where a module looks, as light over a picture: what it attends to less is darker. Dimming changes every object and the
// table alike, which no colour does.
import { useEffect, useRef } from 'preact/hooks';
import type { PictureView } from '../core/types';
import type { Look } from './attention';

const darkest = 0.6;

/** Lies over a picture of `width` by `height` px in the same positioned box; `view` is the part that the policy sees. */
export function Spotlight(props: { module: string; attention: Pick<Look, 'rows' | 'columns' | 'weights'>; view: PictureView; width: number; height: number }) {
  const { attention, width, height } = props;
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const context = canvas.current?.getContext('2d');
    const { rows, columns, weights } = attention;
    if (!context || weights.length !== rows * columns || !weights.length) return;
    const image = new ImageData(columns, rows);
    const most = weights.reduce((a, b) => Math.max(a, b), 1e-9);
    weights.forEach((weight, i) => { image.data[4 * i + 3] = Math.round(255 * darkest * (1 - Math.sqrt(Math.max(0, weight) / most))); });
    context.putImageData(image, 0, 0);
  }, [attention]);
  // of no size: not said, so all of the picture
  const view = props.view.width > 0 && props.view.height > 0 ? props.view : { u: 0, v: 0, width, height };
  const part = (of: number, whole: number) => `${(100 * of) / whole}%`;
  return (
    <canvas ref={canvas} class="spotlight" width={attention.columns} height={attention.rows} data-attention={props.module} aria-hidden="true"
      style={{ left: part(view.u, width), top: part(view.v, height), width: part(view.width, width), height: part(view.height, height) }} />
  );
}
