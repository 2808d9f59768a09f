// SPDX-License-Identifier: Apache-2.0
// Rows in columns; only those in view exist, and below 640 px they are cards. Order holds still while one points at it.
import type { ComponentChildren } from 'preact';
import { useEffect, useLayoutEffect, useRef, useState } from 'preact/hooks';
import { navigate } from '../core/router';
import { useKeys } from '../core/keys';

export interface Column<Row> {
  key: string;
  title: string;
  /** CSS width of the column: '8ch', 'minmax(120px, 1fr)'. */
  width: string;
  number?: boolean;
  /** Sort key of the server; the header becomes a button. */
  sort?: string;
  /** Has what one acts on, so that it cannot be a link to the row. */
  control?: boolean;
  /** In a card: its heading, a full line, or left out. */
  card?: 'title' | 'long' | 'none';
  cell: (row: Row) => ComponentChildren;
}

export interface TableProps<Row> {
  label: string;
  columns: Column<Row>[];
  rows: Row[];
  link?: (row: Row) => string | null;
  id: (row: Row) => string | number;
  selected?: string | number | null;
  sort?: string;
  setSort?: (sort: string) => void;
  /** Visible height in px; rows beyond it scroll and only those in view exist. */
  height?: number;
  /** `x` on the row that j and k chose. */
  tick?: (row: Row) => void;
}

function useNarrow(): boolean {
  const [narrow, setNarrow] = useState(() => window.matchMedia('(max-width: 639px)').matches);
  useEffect(() => {
    const media = window.matchMedia('(max-width: 639px)');
    const change = () => setNarrow(media.matches);
    media.addEventListener('change', change);
    return () => media.removeEventListener('change', change);
  }, []);
  return narrow;
}

export function Table<Row>(props: TableProps<Row>) {
  return useNarrow() ? <Cards {...props} /> : <Grid {...props} />;
}

function Cards<Row>(props: TableProps<Row>) {
  const [shown, setShown] = useState(12);
  return (
    <>
      <ul class="cards" aria-label={props.label}>
        {props.rows.slice(0, shown).map((row) => {
          const address = props.link?.(row);
          return (
            <li key={props.id(row)}>
              {props.columns.map((column) => {
                if (column.card === 'none') return null;
                const content = column.cell(row);
                if (content === '' || content === null || content === undefined) return null;
                if (column.card === 'title') return <div class="title">{address ? <a href={address}>{content}</a> : content}</div>;
                return <div class={`pair${column.card === 'long' ? ' long' : ''}`}><span>{column.title}</span><span>{content}</span></div>;
              })}
            </li>
          );
        })}
      </ul>
      {shown < props.rows.length && (
        <div class="more">
          <button type="button" class="button" onClick={() => setShown(shown + 24)}>Show more</button>
          <span class="muted small">{Math.min(shown, props.rows.length)} of {props.rows.length} loaded</span>
        </div>
      )}
    </>
  );
}

function Grid<Row>(props: TableProps<Row>) {
  const scroller = useRef<HTMLDivElement>(null);
  const [view, setView] = useState({ from: 0, to: 60 });
  const [active, setActive] = useState(-1);
  const rowHeight = useRef(28);
  const virtual = props.height !== undefined && props.rows.length > 60;
  const template = props.columns.map((column) => column.width).join(' ');
  // rows are grids of their own: the same least width keeps their columns in line
  const least = `calc(${props.columns.map((column) => /^minmax\(([^,]+),/.exec(column.width)?.[1] ?? column.width).join(' + ')} + ${12 * (props.columns.length - 1) + 32}px)`;
  const measure = () => {
    const box = scroller.current;
    if (!box || !virtual) return;
    rowHeight.current = parseFloat(getComputedStyle(document.documentElement).getPropertyValue('--row')) || 28;
    const from = Math.max(0, Math.floor(box.scrollTop / rowHeight.current) - 20);
    const to = Math.ceil((box.scrollTop + box.clientHeight) / rowHeight.current) + 20;
    if (from !== view.from || to !== view.to) setView({ from, to });
  };
  useLayoutEffect(measure, [props.rows.length, props.height]);
  const move = (by: number) => {
    const next = Math.max(0, Math.min(props.rows.length - 1, active + by));
    setActive(next);
    if (virtual) scroller.current?.scrollTo({ top: Math.max(0, next * rowHeight.current - (props.height ?? 0) / 2) });
    else scroller.current?.querySelectorAll('.line')[next]?.scrollIntoView({ block: 'nearest' });
  };
  // of several tables of a page the one that has the focus, else the first
  const when = () => {
    const focused = document.activeElement?.closest('.table');
    return scroller.current !== null && scroller.current === (focused ?? document.querySelector('.table'));
  };
  const linked = props.columns.findIndex((column) => !column.control);
  useKeys([
    ...(props.tick ? [{ keys: 'x', does: 'tick the row', when, run: () => {
      const row = props.rows[active];
      if (row !== undefined) props.tick?.(row);
    } }] : []),
    { keys: 'j', does: 'next row', when, run: () => move(1) },
    { keys: 'k', does: 'previous row', when, run: () => move(-1) },
    { keys: 'Enter', does: 'open the row', when, run: () => {
      const row = props.rows[active];
      const address = row !== undefined ? props.link?.(row) : null;
      if (address) navigate(address);
    } },
  ]);
  const from = virtual ? view.from : 0;
  const rows = virtual ? props.rows.slice(view.from, view.to) : props.rows;
  return (
    <div class="table scroll" ref={scroller} onScroll={measure} tabIndex={0} role="group" aria-label={props.label}
      style={props.height ? { maxHeight: `${props.height}px` } : {}}>
      <div role="table" aria-label={props.label} aria-rowcount={props.rows.length + 1} style={{ minWidth: least }}>
        <div class="head" role="row" style={{ gridTemplateColumns: template }}>
          {props.columns.map((column) => <HeadCell column={column} sort={props.sort} setSort={props.setSort} />)}
        </div>
        <div role="rowgroup" class={virtual ? 'spacer' : ''} style={virtual ? { height: `${props.rows.length * rowHeight.current}px` } : {}}>
          {virtual && <div role="presentation" style={{ height: `${from * rowHeight.current}px` }} />}
          {rows.map((row, i) => {
            const address = props.link?.(row) ?? null;
            const id = props.id(row);
            return (
              <div class="line" role="row" key={id} aria-rowindex={from + i + 2} data-id={id} {...(address ? { 'data-link': '' } : {})} {...(from + i === active ? { 'data-active': '' } : {})}
                {...(props.selected === id ? { 'aria-selected': 'true' } : {})} style={{ gridTemplateColumns: template }}
                onClick={(event) => { if (address && opens(event)) navigate(address); }}>
                {props.columns.map((column, c) => (
                  <span class={`cell${column.number ? ' num' : ''}`} role="cell" data-column={column.key}>
                    {c === linked && address ? <a href={address}>{column.cell(row)}</a> : column.cell(row)}
                  </span>
                ))}
              </div>
            );
          })}
        </div>
      </div>
    </div>
  );
}

/** Whether a click on a row opens it: not one that ends a marking of text, or that is its link's own matter. */
function opens(event: MouseEvent): boolean {
  if (event.ctrlKey || event.metaKey || event.shiftKey || event.altKey) return false;
  if (window.getSelection()?.isCollapsed === false) return false;
  return !(event.target as Element).closest('a, button, input, select, label');
}

function HeadCell<Row>(props: { column: Column<Row>; sort: string | undefined; setSort: ((sort: string) => void) | undefined }) {
  const { column, sort, setSort } = props;
  const direction = !column.sort || !sort ? undefined : sort === column.sort ? 'ascending' : sort === `-${column.sort}` ? 'descending' : undefined;
  return (
    <span class={`cell${column.number ? ' num' : ''}`} role="columnheader" {...(direction ? { 'aria-sort': direction as 'ascending' } : {})}>
      {column.sort && setSort
        ? <button type="button" onClick={() => setSort(direction === 'descending' ? column.sort! : `-${column.sort}`)}>{column.title}{direction === 'ascending' ? ' ▴' : direction === 'descending' ? ' ▾' : ''}</button>
        : column.title}
    </span>
  );
}
