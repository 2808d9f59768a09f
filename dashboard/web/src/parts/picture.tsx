// SPDX-License-Identifier: Apache-2.0
// The stored picture of a step, its exact pixels, with marks drawn over it: dark-theme colour between black and white.
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { root } from '../core/api';
import type { Camera, Episode } from '../core/types';
import { MarkLayers, type Glyph } from './mark';
import type { Playhead } from './playhead';

export interface Mark { token: string; label: string; glyph: Glyph; /** (steps, 2) pixels. */ pixels: ArrayLike<number> }

const kept = 160;
const ahead = 8;

/** Pictures of one camera, kept while the page shows them. */
class Pictures {
  private readonly cache = new Map<number, Promise<ImageData>>();
  private readonly underWay = new Map<number, AbortController>();
  constructor(private readonly episode: Episode, private readonly camera: Camera) {}

  /** Picture k; the next ones come after it, and whatever else was under way is not asked for any longer: a hand that drags the
   * playhead passes more pictures than a link brings. */
  get(k: number): Promise<ImageData> {
    for (const [other, abort] of this.underWay) {
      if (other >= k && other <= k + ahead) continue;
      this.underWay.delete(other);
      this.cache.delete(other);
      abort.abort();
    }
    const picture = this.load(k);
    for (let next = k + 1; next <= k + ahead && next < this.camera.frames; next++) this.load(next).catch(() => undefined);
    return picture;
  }

  /** Nobody waits for any of them any more. */
  stop(): void {
    for (const abort of this.underWay.values()) abort.abort();
    this.underWay.clear();
    this.cache.clear();
  }

  private load(k: number): Promise<ImageData> {
    const known = this.cache.get(k);
    if (known) return known;
    const { width_px, height_px, name } = this.camera;
    const abort = new AbortController();
    const loading = fetch(`${root}/datasets/${this.episode.dataset}/episodes/${this.episode.index}/pictures/${encodeURIComponent(name)}/${k}.rgb`, { signal: abort.signal })
      .then((answer) => (answer.ok ? answer.arrayBuffer() : Promise.reject(new Error(`picture ${k}: ${answer.status} ${answer.statusText}`))))
      .then((buffer) => toImage(new Uint8Array(buffer), width_px, height_px));
    this.cache.set(k, loading);
    this.underWay.set(k, abort);
    loading.catch(() => { if (this.cache.get(k) === loading) this.cache.delete(k); })
      .finally(() => { if (this.underWay.get(k) === abort) this.underWay.delete(k); });
    if (this.cache.size > kept) this.cache.delete(this.cache.keys().next().value!);
    return loading;
  }
}

function toImage(rgb: Uint8Array, width: number, height: number): ImageData {
  if (rgb.length !== width * height * 3) throw new Error(`a picture of ${rgb.length} bytes, expected ${width * height * 3}`);
  const image = new ImageData(width, height);
  for (let from = 0, to = 0; from < rgb.length; from += 3, to += 4) {
    image.data[to] = rgb[from]!;
    image.data[to + 1] = rgb[from + 1]!;
    image.data[to + 2] = rgb[from + 2]!;
    image.data[to + 3] = 255;
  }
  return image;
}

export function PictureView(props: { episode: Episode; camera: Camera; playhead: Playhead; marks: Mark[] }) {
  const { episode, camera, playhead } = props;
  const canvas = useRef<HTMLCanvasElement>(null);
  const groups = useRef<(SVGGElement | null)[]>([]);
  const [problem, setProblem] = useState('');
  const pictures = useMemo(() => new Pictures(episode, camera), [episode, camera]);
  useEffect(() => () => pictures.stop(), [pictures]);
  useEffect(() => {
    let shown = -1;
    let gone = false;
    const stop = playhead.follow((step) => {
      props.marks.forEach((mark, i) => {
        const u = mark.pixels[2 * step];
        const v = mark.pixels[2 * step + 1];
        const group = groups.current[i];
        if (!group) return;
        const inside = u !== undefined && v !== undefined && Number.isFinite(u) && Number.isFinite(v);
        group.style.display = inside ? '' : 'none';
        if (inside) group.setAttribute('transform', `translate(${u} ${v})`);
      });
      const k = Math.min(camera.frames - 1, Math.floor(step / episode.image_stride));
      if (k === shown) return;
      shown = k;
      pictures.get(k).then((image) => {
        if (gone || shown !== k) return;
        setProblem('');
        const element = canvas.current;
        element?.getContext('2d')?.putImageData(image, 0, 0);
        element?.setAttribute('data-picture', String(k));
      }).catch((error: unknown) => { if (!gone && shown === k) setProblem(error instanceof Error ? error.message : String(error)); });
    });
    return () => { gone = true; stop(); };
  }, [episode, camera, pictures, playhead, props.marks]);
  return (
    <div class="picture" style={{ aspectRatio: `${camera.width_px} / ${camera.height_px}` }}>
      <canvas ref={canvas} width={camera.width_px} height={camera.height_px} role="img" aria-label={`Camera ${camera.name}`} />
      <svg viewBox={`0 0 ${camera.width_px} ${camera.height_px}`} aria-hidden="true">
        {props.marks.map((mark, i) => (
          <g class="mark" data-mark={mark.label} ref={(element: SVGGElement | null) => { groups.current[i] = element; }}>
            <MarkLayers token={mark.token} glyph={mark.glyph} />
          </g>))}
      </svg>
      {problem && <p class="picture-problem">{problem}</p>}
    </div>
  );
}
