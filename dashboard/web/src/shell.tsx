// SPDX-License-Identifier: Apache-2.0
// What stands around every page: rail, sources, the sentence of state, connection, theme, help.
import { useEffect, useRef, useState } from 'preact/hooks';
import { useResource } from './core/api';
import { connection, lastHeard, now, useLive } from './core/connection';
import { age, clock } from './core/format';
import { active, enabled, setEnabled, useKeys, type Binding } from './core/keys';
import { canShow, labelOf, parameterOf } from './core/choice';
import { link, location, navigate } from './core/router';
import { choose, chosen, home, listed, nameOf, sourceOf, sourcesOf, type Kind } from './core/sources';
import { choose as paint, theme, type Theme } from './core/theme';
import type { Home } from './core/types';
import { pages, type Page } from './pages/index';
import { Empty, Failed, Select } from './parts/basics';
import { Boundary } from './parts/boundary';
import { SignIn } from './parts/sign_in';

export function Icon(props: { path: string }) {
  return <svg class="icon" viewBox="0 0 16 16" aria-hidden="true"><path d={props.path} /></svg>;
}

/** Address of a page with the sources that this one shows; Training alone shows several at once. */
function pageLink(page: Page): string {
  const query = location.value.query;
  const all = home.value?.sources ?? [];
  return link(page.path, Object.fromEntries(page.sources.map((kind) => {
    const named = query.get(parameterOf(kind));
    const id = page.path === 'training' ? named : (listed(named)[0] ?? null);
    return [parameterOf(kind), id !== null && canShow(all, kind, id) ? id : null];
  })));
}

export function Shell() {
  const first = useResource<Home>('/home');
  const live = useLive<Home>('home');
  const newest = live ?? first.data;
  useEffect(() => { if (newest) home.value = newest; }, [newest]);
  const [menu, setMenu] = useState(false);
  const [help, setHelp] = useState(false);
  const path = location.value.path;
  const page = pages.find((one) => one.path === (path[0] ?? ''));
  const address = path.join('/');
  const before = useRef(address);
  useEffect(() => {
    setMenu(false);
    // who reads by ear or keyboard goes on at the new page, not at the link that led there
    if (before.current !== address) document.getElementById('main')?.focus({ preventScroll: true });
    before.current = address;
    document.title = `${page?.title ?? 'Not found'} · Etude`;
  }, [address]);

  useKeys([
    ...pages.filter((one) => one.key).map((one) => ({ keys: `g ${one.key}`, does: one.title, run: () => navigate(pageLink(one)) })),
    { keys: '/', does: 'filter', run: () => document.querySelector<HTMLElement>('[data-filter]')?.focus() },
    { keys: 'c', does: 'copy the first command', run: () => [...document.querySelectorAll<HTMLElement>('[data-copy]')].find((one) => one.checkVisibility())?.click() },
    { keys: 'Escape', does: 'close, or up', run: () => (help ? setHelp(false) : menu ? setMenu(false) : up(path)) },
    { keys: '?', does: 'this list', run: () => setHelp(true) },
  ]);

  if (connection.value === 'denied') return <SignIn />;
  return (
    <div class="shell">
      <a class="skip button" href="#main" onClick={(event) => { event.preventDefault(); document.getElementById('main')?.focus(); }}>Skip to the page</a>
      <Rail open={menu} page={page} />
      <div>
        <Top page={page} sentence={newest?.sentence ?? ''} menu={menu} setMenu={setMenu} help={() => setHelp(true)} />
        {connection.value === 'lost' && <Gone />}
        <main id="main" tabIndex={-1} onClick={() => setMenu(false)}>
          <h1 class={page?.path === '' || page?.hidden ? 'sr' : ''}>{page?.title ?? 'Not found'}</h1>
          {first.error && !newest && <Failed problem={first.error} retry={first.reload} />}
          {page ? (newest || first.error ? <Boundary of={address + location.value.query.toString()}><page.view key={page.path} /></Boundary> : null) : <Empty title="There is no such page">{`Nothing is at /${address}.`} <a href="/">Overview</a></Empty>}
        </main>
      </div>
      {help && <Help close={() => setHelp(false)} />}
    </div>
  );
}

function Top(props: { page: Page | undefined; sentence: string; menu: boolean; setMenu: (open: boolean) => void; help: () => void }) {
  const { page, sentence, menu } = props;
  return (
    <header class="top">
      <button type="button" class="button icon-only menu" aria-label="Pages" aria-expanded={menu} onClick={() => props.setMenu(!menu)}><Icon path="M2 4h12M2 8h12M2 12h12" /></button>
      {page && page.sources.length > 0 && <Pickers page={page} />}
      <p class="sentence" title={sentence} data-sentence>{page?.path === '' ? '' : sentence}</p>
      <ConnectionDot />
      <ThemeSwitch />
      <button type="button" class="button plain icon-only" aria-label="Keyboard shortcuts" onClick={props.help}>?</button>
    </header>
  );
}

function up(path: string[]): void {
  if (path[0] === 'episode' && path[1]) navigate(link('dataset', { dataset: path[1] }));
  else if (path.length > 1) navigate(`/${path.slice(0, -1).join('/')}`);
}

function Rail(props: { open: boolean; page: Page | undefined }) {
  const groups = [...new Set(pages.filter((one) => !one.hidden).map((one) => one.group))];
  return (
    <nav class="rail" aria-label="Pages" {...(props.open ? { 'data-open': '' } : {})}>
      <div>
      <a class="brand" href="/"><img src="/icon.svg" alt="" />Etude</a>
      {groups.map((group) => (
        <div>
          {group && <h2>{group}</h2>}
          <ul>
            {pages.filter((one) => one.group === group && !one.hidden).map((one) => (
              <li><a href={pageLink(one)} {...(one === props.page ? { 'aria-current': 'page' as const } : {})}><Icon path={one.icon} />{one.title}</a></li>
            ))}
          </ul>
        </div>
      ))}
      </div>
    </nav>
  );
}

function Pickers(props: { page: Page }) {
  return (
    <div class="row pickers">
      {props.page.sources.map((kind) => <Picker kind={kind} />)}
    </div>
  );
}

function Picker(props: { kind: Kind }) {
  const { kind } = props;
  const id = listed(chosen(kind))[0] ?? '';
  const all = sourcesOf(kind, kind === 'dataset' && sourceOf(id)?.role === 'rollouts');
  if (!all.length) return null;
  const options = all.map((one) => [one.id, labelOf(all, one)] as const);
  if (!all.some((one) => one.id === id)) options.unshift([id, sourceOf(id) ? nameOf(id) : `${id} (not listed)`]);
  return <Select label={kind} value={id} options={options} choose={(value) => choose(kind, value)} />;
}

function ConnectionDot() {
  const state = connection.value;
  const since = now.value - lastHeard.value;
  const text = state === 'wait' ? 'connecting' : state === 'lost' ? 'no gateway' : since < 3000 ? 'live' : age(since);
  // said when it changes, and not twice a second while it ages
  const told = state === 'live' ? (since < 10000 ? 'The gateway is heard' : 'The gateway is silent') : state === 'lost' ? 'The gateway does not answer' : 'Connecting';
  return <span class="connection" data-state={state} title="Time since the gateway was heard"><span aria-hidden="true">{text}</span><span class="sr" role="status">{told}</span></span>;
}

function Gone() {
  return (
    <div class="banner" role="alert">
      <b>The gateway does not answer.</b>
      <span>{lastHeard.value ? `What you see is from ${clock(lastHeard.value)}.` : ''} Trying again by itself.</span>
    </div>
  );
}

const order: Theme[] = ['system', 'light', 'dark'];

function ThemeSwitch() {
  const next = order[(order.indexOf(theme.value) + 1) % order.length]!;
  const icon = { system: 'M2 3h12v8H2zM6 14h4M8 11v3', light: 'M8 5a3 3 0 100 6 3 3 0 000-6zM8 1v1M8 14v1M1 8h1M14 8h1M3 3l.7.7M12.3 12.3l.7.7M3 13l.7-.7M12.3 3.7L13 3', dark: 'M13 9.5A5.5 5.5 0 016.5 3 5.5 5.5 0 1013 9.5z' };
  return (
    <button type="button" class="button plain icon-only" aria-label={`Theme: ${theme.value}; change to ${next}`} title={`Theme: ${theme.value}`} onClick={() => paint(next)}>
      <Icon path={icon[theme.value]} />
    </button>
  );
}

function Help(props: { close: () => void }) {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => { dialog.current?.showModal(); }, []);
  const bindings = active().filter((one, i, all) => all.findIndex((other: Binding) => other.keys === one.keys) === i);
  return (
    <dialog ref={dialog} onClose={props.close} aria-labelledby="help-title">
      <div class="row apart"><h2 id="help-title" class="figure">Keyboard</h2><button type="button" class="button" onClick={() => dialog.current?.close()}>Close</button></div>
      <div class="keymap">{bindings.map((one) => [<span>{one.keys.split(' ').map((key) => <><kbd>{key}</kbd> </>)}</span>, <span>{one.does}</span>])}</div>
      <p class="keymap"><label class="inline"><input type="checkbox" checked={enabled.value} onChange={(event) => setEnabled(event.currentTarget.checked)} /> single keys act</label></p>
      <p class="small muted">Etude {home.value?.version} · {home.value?.dirs.join(', ')} {home.value?.domain !== null && home.value?.domain !== undefined ? `· DDS domain ${home.value.domain}` : '· no bus'} · <a href="/licenses.txt" target="_blank" rel="noreferrer">licences of what is bundled</a></p>
    </dialog>
  );
}
