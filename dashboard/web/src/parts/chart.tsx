// SPDX-License-Identifier: Apache-2.0
// Lines over x by uPlot (loaded with the first chart that is seen): made once, fed in animation frames, one cursor for the page, a hidden table for those who cannot see a canvas.
import type uPlot from 'uplot';
import { useEffect, useLayoutEffect, useRef, useState } from 'preact/hooks';
import { epoch } from '../core/connection';
import { color, paints } from '../core/theme';
import { axisLabels, number } from '../core/format';
import { align } from '../core/lines';
import { zoomedBy, type Range } from '../core/range';
import { summarize } from '../core/stats';
import { drawMarkers, Marker } from './marker';

export interface Line {
  label: string;
  /** Token of its colour. */
  token: string;
  x: ArrayLike<number>;
  values: ArrayLike<number | null>;
  /** Bounds of what each point stands for, where points were merged. */
  min?: ArrayLike<number | null>;
  max?: ArrayLike<number | null>;
  /** What it is stacked upon: drawn above it, and filled from there. */
  base?: ArrayLike<number>;
  dash?: boolean;
  points?: boolean;
  faint?: boolean;
  /** Of which run it is where several are drawn, for its shape. */
  marker?: number;
}

export interface ChartProps {
  title: string;
  unit?: string;
  lines: Line[];
  height?: number;
  /** Spans of x with a name, drawn behind. */
  bands?: { from: number; to: number; label: string }[];
  marks?: { x: number; token: string; glyph: string }[];
  goal?: number | null;
  log?: boolean;
  /** Charts with the same key share their cursor. */
  sync?: string;
  range?: Range | null;
  /** `replace`: by key, which makes no entry in the history. */
  zoom?: (range: Range | null, replace?: boolean) => void;
  xLabel?: string;
  xFormat?: (x: number) => string;
  cursor?: (x: number | null) => void;
  /** A moment shown elsewhere on the page, marked without rendering anew. */
  follow?: { follow: (listener: (x: number) => void) => () => void };
  /** A click says which x. */
  pick?: (x: number) => void;
  note?: string;
}

const font = '12px system-ui, sans-serif';

let loaded: typeof uPlot | null = null;

/** uPlot, from the first chart that is seen on; a gateway that was away may have it when it is back. */
function usePlot(wanted: boolean): { Plot: typeof uPlot | null; failed: boolean } {
  const [Plot, show] = useState<typeof uPlot | null>(() => loaded);
  const [failed, fail] = useState(false);
  const generation = epoch.value;
  useEffect(() => {
    if (!wanted || Plot) return;
    import('uplot').then((all) => show(() => (loaded = all.default)), () => fail(true));
  }, [wanted, generation]);
  return { Plot, failed: failed && !Plot };
}

export function Chart(props: ChartProps) {
  const host = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  const latest = useRef(props);
  latest.current = props;
  const legend = useRef<(HTMLElement | null)[]>([]);
  const live = useRef<HTMLParagraphElement>(null);
  const [visible, setVisible] = useState(false);
  const shape = props.lines.map((line) => `${line.label}|${line.token}|${line.dash}|${line.points}|${line.faint}`).join() + props.log;
  const paint = paints.value;

  useEffect(() => {
    const watcher = new IntersectionObserver(([entry]) => { if (entry?.isIntersecting) setVisible(true); }, { rootMargin: '300px' });
    if (host.current) watcher.observe(host.current);
    return () => watcher.disconnect();
  }, []);

  const { Plot, failed } = usePlot(visible);
  useEffect(() => {
    const box = host.current;
    if (!visible || !Plot || !box) return;
    const made = new Plot(options(latest, legend, box.clientWidth), data(latest.current), box);
    plot.current = made;
    const resize = new ResizeObserver(() => { if (box.clientWidth > 0) made.setSize({ width: box.clientWidth, height: latest.current.height ?? 150 }); });
    resize.observe(box);
    const pick = () => { if (made.cursor.idx !== null && made.cursor.idx !== undefined) latest.current.pick?.(made.data[0][made.cursor.idx]!); };
    made.over.addEventListener('click', pick);
    const stop = followed(made, latest.current.follow);
    return () => {
      resize.disconnect();
      stop();
      made.destroy();
      plot.current = null;
    };
  }, [visible, Plot, shape, props.follow]);

  useEffect(() => {
    const frame = requestAnimationFrame(() => {
      if (!plot.current) return;
      plot.current.setData(data(latest.current), true);
    });
    return () => cancelAnimationFrame(frame);
  }, [props.lines]);
  // written here and by the cursor, never by both Preact and the cursor: it would go on with a text that is not shown
  useLayoutEffect(() => {
    props.lines.forEach((line, i) => {
      const element = legend.current[i];
      if (element && (plot.current?.cursor.idx ?? null) === null) element.textContent = number(summarize(line.values).last);
    });
  }, [props.lines]);
  useEffect(() => { plot.current?.redraw(false, true); }, [paint, props.bands, props.marks, props.goal]);
  useEffect(() => {
    const made = plot.current;
    if (!made) return;
    made.setData(data(latest.current), true);
  }, [props.range?.[0], props.range?.[1]]);

  const press = (event: KeyboardEvent) => {
    const made = plot.current;
    if (!made || event.ctrlKey || event.metaKey || event.altKey) return;
    const said = event.key.startsWith('Arrow') ? moveCursor(made, props, event) : props.zoom ? zoomBy(made, props, event.key) : null;
    if (said === null) return;
    event.preventDefault();
    if (live.current) live.current.textContent = said;
  };

  const missing = props.lines.reduce((sum, line) => sum + (line.faint ? 0 : summarize(line.values).missing), 0);
  return (
    <figure class="chart" data-chart={props.title} data-goal={props.goal ?? undefined}>
      <figcaption>
        <h3>{props.title}{props.unit && <span class="muted small"> {props.unit}</span>}</h3>
        {props.note && <span class="small muted">{props.note}</span>}
        {missing > 0 && <span class="small bad">{missing} not finite</span>}
      </figcaption>
      <div class="legend">
        {props.lines.map((line, i) => !line.faint && (
          <span class="key">
            <svg aria-hidden="true" viewBox="0 0 18 8"><line x1="0" x2="18" y1="4" y2="4" stroke={`var(--${line.token})`} stroke-width="2" {...(line.dash ? { 'stroke-dasharray': '4 3' } : {})} />{line.points && line.marker === undefined && <circle cx="9" cy="4" r="3" fill={`var(--${line.token})`} />}</svg>
            {line.marker !== undefined && <Marker of={line.marker} token={line.token} />}
            {line.label} <b ref={(element) => { legend.current[i] = element; }} />
          </span>
        ))}
      </div>
      {failed && <p class="small bad" role="alert" data-no-plot>The script that draws it did not come: reload the page.</p>}
      <div class="plot" ref={host} tabIndex={0} role="img" data-arrows aria-label={`${props.title}${props.unit ? `, ${props.unit}` : ''}: ${props.lines.map((line) => describe(line)).join('; ')}. Arrow keys move the cursor${props.zoom ? ', + and - zoom, 0 shows all' : ''}.`}
        style={{ height: `${props.height ?? 150}px` }} onKeyDown={press} onDblClick={() => props.zoom?.(null)} />
      <p class="sr" aria-live="polite" ref={live} />
      <HiddenTable {...props} />
    </figure>
  );
}

/** To the point beside; what stands there, in words. Null: there is none. */
function moveCursor(made: uPlot, props: ChartProps, event: KeyboardEvent): string | null {
  const step = (event.shiftKey ? 10 : 1) * (event.key === 'ArrowLeft' || event.key === 'ArrowDown' ? -1 : 1);
  const n = made.data[0].length;
  if (n === 0) return null;
  const index = Math.max(0, Math.min(n - 1, (made.cursor.idx ?? n - 1) + step));
  made.setCursor({ left: made.valToPos(made.data[0][index]!, 'x'), top: 10 });
  return `${(props.xLabel ?? 'step')} ${made.data[0][index]}: ` + props.lines.flatMap((line, i) => (line.faint ? [] : `${line.label} ${number(valueAt(made, line, i, index))}`)).join(', ');
}

/** Of the line itself, without what it is stacked upon. */
function valueAt(u: uPlot, line: Line, i: number, index: number): number | null | undefined {
  const top = u.data[1 + 3 * i]?.[index];
  return line.base && typeof top === 'number' ? top - (u.data[2 + 3 * i]?.[index] ?? 0) : top;
}

/** About the cursor; null: the key does nothing here. */
function zoomBy(made: uPlot, props: ChartProps, key: string): string | null {
  const all = made.data[0];
  const next = zoomedBy(key, props.range ?? null, all, all[made.cursor.idx ?? -1] ?? null);
  if (next === undefined) return null;
  props.zoom?.(next, true);
  return next ? `from ${number(next[0], 6)} to ${number(next[1], 6)}` : 'all of it';
}

function followed(made: uPlot, moment: ChartProps['follow']): () => void {
  if (!moment) return () => {};
  const mark = document.createElement('div');
  mark.className = 'at';
  made.over.append(mark);
  let at: number | null = null;
  // the axis has its scale with the first drawing, and another one with each new width
  const place = () => {
    const left = at === null ? NaN : made.valToPos(at, 'x');
    if (Number.isFinite(left)) mark.style.transform = `translateX(${left}px)`;
  };
  (made.hooks.draw ??= []).push(place);
  return moment.follow((x) => { at = x; place(); });
}

function describe(line: Line): string {
  const s = summarize(line.values);
  return s.n ? `${line.label} ${s.n} values, ${number(s.min)} to ${number(s.max)}, last ${number(s.last)}` : `${line.label} no values`;
}

/** What tests and screen readers read: exact figures of each line. */
function HiddenTable(props: ChartProps) {
  return (
    <div class="sr"><table data-table={props.title}>
      <caption>{props.title}{props.unit ? `, ${props.unit}` : ''}</caption>
      <thead><tr><th scope="col">line</th><th scope="col">n</th><th scope="col">min</th><th scope="col">max</th><th scope="col">last</th></tr></thead>
      <tbody>
        {props.lines.filter((line) => !line.faint).map((line) => {
          const s = summarize(line.values);
          const low = line.min ? summarize(line.min).min : s.min;
          const high = line.max ? summarize(line.max).max : s.max;
          return <tr data-line={line.label}><th scope="row">{line.label}</th><td>{s.n}</td><td>{String(low)}</td><td>{String(high)}</td><td>{String(s.last)}</td></tr>;
        })}
      </tbody>
    </table></div>
  );
}

function data(props: ChartProps): uPlot.AlignedData {
  const { x, columns } = align(props.lines);
  return [x, ...columns] as unknown as uPlot.AlignedData;
}

function options(props: { current: ChartProps }, legend: { current: (HTMLElement | null)[] }, width: number): uPlot.Options {
  const now = props.current;
  const series: uPlot.Series[] = [{}];
  const bands: uPlot.Band[] = [];
  now.lines.forEach((line, i) => {
    const stroke = () => color(line.token);
    series.push({
      label: line.label, stroke, width: line.faint ? 1 : 1.75, ...(line.dash ? { dash: [5, 4] } : {}), alpha: line.faint ? 0.35 : 1, spanGaps: false,
      points: { show: line.marker !== undefined ? false : line.points ? true : undefined as unknown as boolean, size: line.points ? 5 : 3, fill: stroke, stroke },
    });
    // the spread of merged points, filled and without outline
    series.push({ width: 0, points: { show: false } }, { width: 0, points: { show: false } });
    bands.push({ series: [3 * i + 3, 3 * i + 2], fill: () => color(line.token).replace('rgb(', 'rgba(').replace(')', ', 0.18)') });
  });
  const axis = { stroke: () => color('muted'), font, grid: { stroke: () => color('line'), width: 1 }, ticks: { show: false }, border: { show: false } };
  return {
    width: Math.max(80, width), height: now.height ?? 150, legend: { show: false }, padding: [8, 8, 0, 0],
    cursor: {
      ...(now.sync ? { sync: { key: now.sync, setSeries: false } } : {}),
      drag: { x: Boolean(now.zoom), y: false, setScale: false, uni: 10 }, points: { size: 6 }, y: false,
    },
    scales: {
      x: { time: false, range: (_u, low, high) => props.current.range ?? (low === high ? [low - 1, high + 1] : [low, high]) },
      y: { ...(now.log ? { distr: 4, asinh: 1e-4 } : {}), range: (_u, low, high) => yRange(props.current, low, high) },
    },
    series, bands,
    axes: [
      { ...axis, size: 24, gap: 4, space: 56, values: (_u, splits) => (props.current.xFormat ? splits.map(props.current.xFormat) : axisLabels(splits)) },
      { ...axis, size: 52, gap: 6, space: 32, values: (_u, splits) => (now.log ? splits.map((value, i) => (value === null || i % 2 ? '' : compact(value))) : axisLabels(splits)) },
    ],
    hooks: {
      drawClear: [(u) => drawBehind(u, props.current)],
      draw: [(u) => drawAbove(u, props.current)],
      setCursor: [(u) => {
        const index = u.cursor.idx;
        props.current.lines.forEach((line, i) => {
          const element = legend.current[i];
          if (!element) return;
          const value = index === null || index === undefined ? null : valueAt(u, line, i, index);
          element.textContent = number(value ?? (index === null || index === undefined ? summarize(line.values).last : null));
        });
        props.current.cursor?.(index === null || index === undefined ? null : u.data[0][index]!);
      }],
      setSelect: [(u) => {
        if (u.select.width < 4) return;
        props.current.zoom?.([u.posToVal(u.select.left, 'x'), u.posToVal(u.select.left + u.select.width, 'x')]);
        u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      }],
    },
  };
}

function yRange(props: ChartProps, low: number | null, high: number | null): [number, number] {
  let from = low ?? 0;
  let to = high ?? 1;
  if (props.goal !== null && props.goal !== undefined) {
    from = Math.min(from, props.goal);
    to = Math.max(to, props.goal);
  }
  if (from === to) return [from - (Math.abs(from) || 1) * 0.1, to + (Math.abs(to) || 1) * 0.1];
  const pad = (to - from) * 0.06;
  return [from >= 0 && from - pad < 0 ? Math.min(0, from) : from - pad, to + pad];
}

/** Of a logarithmic axis, whose ticks are not evenly apart. */
function compact(value: number): string {
  const size = Math.abs(value);
  if (size >= 1e6) return `${number(value / 1e6, 2)}M`;
  if (size >= 1e4) return `${number(value / 1e3, 3)}k`;
  return size !== 0 && size < 0.001 ? value.toExponential(0) : String(+value.toPrecision(3));
}

function drawBehind(u: uPlot, props: ChartProps): void {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
  ctx.textBaseline = 'top';
  ctx.textAlign = 'left';
  props.bands?.forEach((band, i) => {
    const left = Math.max(bbox.left, u.valToPos(band.from, 'x', true));
    const right = Math.min(bbox.left + bbox.width, u.valToPos(band.to, 'x', true));
    if (right <= left) return;
    if (i % 2) {
      ctx.fillStyle = color('hover');
      ctx.fillRect(left, bbox.top, right - left, bbox.height);
    }
    ctx.fillStyle = color('muted');
    if (bbox.height > 160 * devicePixelRatio && right - left > ctx.measureText(band.label).width + 8) ctx.fillText(band.label, left + 4 * devicePixelRatio, bbox.top + 2);
  });
  ctx.restore();
}

function drawAbove(u: uPlot, props: ChartProps): void {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.lineWidth = devicePixelRatio;
  if (props.goal !== null && props.goal !== undefined) {
    const y = u.valToPos(props.goal, 'y', true);
    ctx.setLineDash([3 * devicePixelRatio, 3 * devicePixelRatio]);
    ctx.strokeStyle = color('good');
    line(ctx, bbox.left, y, bbox.left + bbox.width, y);
    ctx.setLineDash([]);
  }
  for (const mark of props.marks ?? []) {
    const x = u.valToPos(mark.x, 'x', true);
    if (x < bbox.left - 1 || x > bbox.left + bbox.width + 1) continue;
    ctx.fillStyle = color(mark.token);
    ctx.font = `${10 * devicePixelRatio}px system-ui, sans-serif`;
    ctx.textAlign = 'center';
    ctx.fillText(mark.glyph, x, bbox.top + bbox.height - 3 * devicePixelRatio);
  }
  props.lines.forEach((one, i) => { if (one.marker !== undefined && !one.faint) drawShapes(u, one, 1 + 3 * i); });
  // a value that is not finite is a red tick on the axis, not a gap without a word
  ctx.strokeStyle = color('bad');
  props.lines.forEach((one) => {
    for (let i = 0; i < one.x.length; i++) {
      const value = one.values[i];
      if (value === undefined || (value !== null && Number.isFinite(value))) continue;
      const x = u.valToPos(one.x[i]!, 'x', true);
      line(ctx, x, bbox.top + bbox.height - 6 * devicePixelRatio, x, bbox.top + bbox.height);
    }
  });
  ctx.restore();
}

/** A line's markers, on each point where it has points, else here and there. */
function drawShapes(u: uPlot, of: Line, column: number): void {
  const { ctx, bbox } = u;
  const points: [number, number][] = [];
  u.data[0].forEach((x, i) => {
    const value = u.data[column]?.[i];
    const left = u.valToPos(x, 'x', true);
    if (typeof value === 'number' && left >= bbox.left && left <= bbox.left + bbox.width) points.push([left, u.valToPos(value, 'y', true)]);
  });
  ctx.fillStyle = color(of.token);
  drawMarkers(ctx, of.marker ?? 0, points, of.points ? 0 : 96 * devicePixelRatio);
}

function line(ctx: CanvasRenderingContext2D, x0: number, y0: number, x1: number, y1: number): void {
  ctx.beginPath();
  ctx.moveTo(x0, y0);
  ctx.lineTo(x1, y1);
  ctx.stroke();
}

/** A line without axes, for a tile. */
export function Spark(props: { values: number[]; label: string }) {
  const top = Math.max(1e-9, ...props.values);
  const n = Math.max(2, props.values.length);
  const points = props.values.map((value, i) => `${(300 * i) / (n - 1)},${34 - (30 * value) / top}`).join(' ');
  return (
    <svg class="spark" viewBox="0 0 300 36" preserveAspectRatio="none" role="img" aria-label={props.label}>
      {props.values.length > 1 && <><polygon points={`0,36 ${points} 300,36`} fill="var(--accent-soft)" /><polyline points={points} fill="none" stroke="var(--accent)" stroke-width="1.5" vector-effect="non-scaling-stroke" /></>}
    </svg>
  );
}

/** Counts in bins as bars, with edges named. */
export function Histogram(props: { edges: number[]; counts: number[]; label: string; format?: (edge: number) => string; height?: number }) {
  const most = Math.max(1, ...props.counts);
  const n = Math.max(1, props.counts.length);
  const height = props.height ?? 96;
  const name = props.format ?? ((edge: number) => number(edge));
  return (
    <figure class="chart" data-histogram={props.label}>
      <svg width="100%" height={height} viewBox={`0 0 ${n * 10} ${height}`} preserveAspectRatio="none" role="img" aria-label={`${props.label}: ${props.counts.map((one, i) => `${name(props.edges[i] ?? 0)} to ${name(props.edges[i + 1] ?? 0)}: ${one}`).join(', ')}`}>
        {props.counts.map((one, i) => one > 0 && <rect x={i * 10 + 0.5} width="9" y={height - Math.max(2, (height * one) / most)} height={Math.max(2, (height * one) / most)} fill="var(--accent)"><title>{`${name(props.edges[i] ?? 0)} – ${name(props.edges[i + 1] ?? 0)}: ${one}`}</title></rect>)}
        <line x1="0" x2={n * 10} y1={height - 0.5} y2={height - 0.5} stroke="var(--edge)" vector-effect="non-scaling-stroke" />
      </svg>
      <div class="row apart small muted" aria-hidden="true"><span>{name(props.edges[0] ?? 0)}</span><span>{name(props.edges[Math.floor(n / 2)] ?? 0)}</span><span>{name(props.edges[n] ?? 0)}</span></div>
    </figure>
  );
}
