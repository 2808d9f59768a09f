// SPDX-License-Identifier: Apache-2.0
// Pages in states that no folder of a test has: many sources that are live at once, answers that fail, a browser without a
// clipboard. The gateway and its pages are real; what it answers is put in its place here.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync } from 'node:fs';
import { after, before, test } from 'node:test';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { axe, launch, openPage, overflow } from './browser.mjs';
import { startGateway } from './gateway.mjs';

const work = mkdtempSync(join(tmpdir(), `etude-test-${process.pid}-`));
let gateway;
let browser;

before(async () => {
  gateway = await startGateway([work], 0, ['--no-bus']);
  browser = await launch();
});

after(async () => {
  await browser?.close();
  await gateway?.stop();
  rmSync(work, { recursive: true, force: true });
});

const source = (kind, id, more = {}) => ({ id, kind, name: id, state: 'finished', updated: null, age_ms: 1000, live: false, folder: id, role: kind === 'dataset' ? 'demonstrations' : null, ...more });

/** /home as the gateway gives it over nothing, with these sources and whatever else is said. */
async function homeOf(sources, more = {}) {
  const home = await (await fetch(`${gateway.address}/api/v1/home`)).json();
  return { ...home, sources, ...more };
}

/**
 * Opens `address`; `answers` by path of the API give a body, { status, json }, or a function of the request's URL, and of
 * the request, that gives either, or will. What they do not name the gateway answers. `push(ch, data, args)` says something
 * on a live channel to whoever subscribed with these arguments; without any, to everybody who has subscribed to it.
 * `drop()` ends the connection, which the page finds again.
 */
async function open(address, answers, look, { allow = /^$/ } = {}) {
  const { page, context, wrong } = await openPage(browser, gateway.address);
  page.setDefaultTimeout(8000);
  const subscribed = new Map();
  const sockets = new Set();
  await page.routeWebSocket(/\/api\/v1\/live/, (socket) => {
    sockets.add(socket);
    socket.onMessage((text) => {
      const { op, ch, id } = JSON.parse(text);
      if (op === 'sub') subscribed.set(id, { socket, ch });
      if (op === 'unsub') subscribed.delete(id);
    });
  });
  await page.route('**/api/v1/**', async (route) => {
    const url = new URL(route.request().url());
    let answer = answers[url.pathname.slice('/api/v1'.length)];
    if (typeof answer === 'function') answer = await answer(url, route.request());
    if (answer === undefined) return route.continue();
    return Buffer.isBuffer(answer) ? route.fulfill({ body: answer, contentType: 'application/octet-stream' })
      : typeof answer.status === 'number' ? route.fulfill(answer) : route.fulfill({ json: answer });
  });
  const push = async (ch, data, args) => {
    const heard = () => [...subscribed].filter(([id, one]) => one.ch === ch && (args === undefined || id === ch + JSON.stringify(args)));
    for (const end = Date.now() + 10000; !heard().length;) {
      assert.ok(Date.now() < end, `nobody has subscribed to ${ch}`);
      await new Promise((done) => setTimeout(done, 20));
    }
    for (const [id, { socket }] of heard()) socket.send(JSON.stringify({ ch, id, seq: 1, t: '', data }));
  };
  const drop = async () => {
    const all = [...sockets];
    sockets.clear();
    subscribed.clear();
    for (const socket of all) await socket.close();
  };
  try {
    await page.goto(gateway.address + address);
    await page.waitForSelector('main h1', { state: 'attached' });
    await look(page, push, drop);
    assert.deepEqual(wrong.filter((one) => !allow.test(one)), []);
  } finally {
    await context.close();
  }
}

/** Asks until the answer is true. */
async function until(what, ask, limit = 12000) {
  for (const end = Date.now() + limit; !(await ask());) {
    assert.ok(Date.now() < end, `waited ${limit / 1000} s for ${what}`);
    await new Promise((done) => setTimeout(done, 20));
  }
}

/** What the page has heard by now it has drawn. */
const drawn = (page) => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));

const host = (name) => ({ host: name, slots: 0, busy: 0, per_min: 1, ok: 1, episodes: 1, failures: 0, plan_p50_s: null, plan_p95_s: null, rss_mb: null, cpu: null, version: '1', fingerprint: null, age_ms: 0, workers: [], processes: [] });
const fleetOf = (names, more = {}) => ({ live: true, total: names.length, workers: 1, per_min: 1, ok: 1, hosts: names.map(host), ...more });

test('what is typed into a search field stays while the page is drawn anew', async () => {
  const asked = [];
  const answers = { '/fleet': (url) => { asked.push(url.searchParams.get('filter')); return fleetOf(['lab-a', 'lab-b']); } };
  await open('/fleet', answers, async (page, push) => {
    const field = page.locator('[data-filter]');
    await field.waitFor();
    for (const [i, letter] of [...'lab-b w1'].entries()) {
      await field.pressSequentially(letter);
      // with the filter the subscription changes: what is said meanwhile is said to nobody
      const told = page.locator(`[data-fleet-summary]:has-text("${i} a minute")`);
      for (const end = Date.now() + 8000; !(await told.count());) {
        assert.ok(Date.now() < end, `${i} a minute is not shown`);
        await push('fleet', fleetOf(['lab-a', 'lab-b'], { per_min: i }));
      }
    }
    assert.equal(await field.inputValue(), 'lab-b w1');
    await page.waitForURL('**filter=lab-b+w1**');
    assert.equal(await field.inputValue(), 'lab-b w1');
    for (const end = Date.now() + 8000; !asked.includes('lab-b w1');) {
      assert.ok(Date.now() < end, `the gateway was asked for ${asked}`);
      await new Promise((done) => setTimeout(done, 20));
    }
  });
});

test('copy works without the clipboard of https, and says what to press where nothing works', async () => {
  const { page, context, wrong } = await openPage(browser, gateway.address);
  try {
    await page.addInitScript(() => {
      Object.defineProperty(Navigator.prototype, 'clipboard', { get: () => undefined });
      document.addEventListener('copy', (event) => { globalThis.copied = event.target.value; });
    });
    await page.goto(`${gateway.address}/training`);
    const command = await page.locator('.command code').first().innerText();
    await page.keyboard.press('c');
    await page.waitForSelector('[data-copy]:has-text("copied")');
    assert.equal(await page.evaluate(() => globalThis.copied), command);
    assert.equal(await page.locator('textarea').count(), 0);
    await page.evaluate(() => { document.execCommand = () => false; });
    await page.locator('[data-copy]').first().click();
    await page.waitForSelector('[data-copy]:has-text("press Ctrl-C")');
    assert.equal(await page.evaluate(() => getSelection().toString()), command);
    assert.deepEqual(wrong, []);
  } finally {
    await context.close();
  }
});

const runOf = (id, more = {}) => ({
  id, name: id, folder: id, identity: null, state: 'running', updated: null, age_ms: 0, live: true, step: 6000, steps: 9000, stage: 1, stages: 2, stage_name: 'LANG', elapsed_s: 1, loss: null, samples_per_s: null,
  data_wait: null, episodes: null, eta_s: null, checkpoint_step: null, modules: [], goals: [], keys: [], nulls: [], lives: [], end: null, dataset: null, config: null, torn: false, ...more,
});
/** All that is asked of a run. */
const answersOf = (id, more = {}) => ({ [`/runs/${id}`]: runOf(id, more), [`/runs/${id}/curriculum`]: { run: id, stages: [] }, [`/runs/${id}/checkpoints`]: { run: id, checkpoints: [], subscribers: [], next_step: null } });
const loss = { key: 'train/loss', kind: 'train', name: 'loss', module: null, unit: null, n: 3, nulls: 0 };

/** A safetensors file of float64 vectors. */
function tensors(all) {
  const header = {};
  let at = 0;
  for (const [name, values] of Object.entries(all)) header[name] = { dtype: 'F64', shape: [values.length], data_offsets: [at, at += 8 * values.length] };
  const text = Buffer.from(JSON.stringify(header).padEnd(Math.ceil(JSON.stringify(header).length / 8) * 8));
  const length = Buffer.alloc(8);
  length.writeBigUInt64LE(BigInt(text.length));
  return Buffer.concat([length, text, Buffer.from(Float64Array.from(Object.values(all).flat()).buffer)]);
}

const curve = (x, last) => tensors({ 'train/loss/x': x, 'train/loss/step': x, 'train/loss/min': last, 'train/loss/max': last, 'train/loss/last': last });

test('a browser that keeps nothing for pages shows them', async () => {
  const { page, context, wrong } = await openPage(browser, gateway.address);
  try {
    await page.addInitScript(() => {
      Object.defineProperty(globalThis, 'localStorage', { get() { throw new DOMException('denied', 'SecurityError'); } });
    });
    await page.goto(gateway.address);
    await page.waitForSelector('main h1', { state: 'attached' });
    await page.getByRole('button', { name: /^Theme/ }).click();
    assert.deepEqual(wrong, []);
  } finally {
    await context.close();
  }
});

test('a page stays with the source that it began with, and its address names it', async () => {
  const runs = ['one', 'two'].map((id) => source('run', id, { live: true }));
  const answers = { '/home': await homeOf(runs), ...answersOf('one'), ...answersOf('two') };
  await open('/training', answers, async (page, push) => {
    await page.waitForURL('**/training?run=one');
    await push('home', await homeOf([...runs].reverse(), { sentence: 'the other one is the newest' }));
    await page.waitForSelector('[data-sentence]:has-text("the other one")');
    assert.equal(new URL(page.url()).searchParams.get('run'), 'one');
    assert.equal(await page.locator('.pickers select').inputValue(), 'one');
    await page.goBack();
    assert.equal(page.url(), 'about:blank', 'the choice is no step of its own');
  });
});

test('another source is shown without the ticks and filters of the one before', async () => {
  const sources = ['a', 'b'].map((id) => source('run', id));
  const answers = { '/home': await homeOf(sources), ...answersOf('a'), ...answersOf('b') };
  await open('/training?run=a&y=log&range=1..2&ticks=4', answers, async (page) => {
    await page.locator('.pickers select').selectOption('b');
    await page.waitForURL((url) => url.searchParams.get('run') === 'b');
    assert.equal(new URL(page.url()).search, '?run=b&y=log');
  });
});

test('what is on the bus alone says so, on every page that would read its files', async () => {
  const campaign = { id: 'bus', name: 'bus', state: 'running', dataset: null, spec: null, spec_sha256: null, failures: { plan_failed: 1 }, failures_by: [], timing: null, tasks: [], robots: [],
    status: { attempts: 4, committed: 3, total: 10, given_up: 0, live: true, per_min: 5, eta_s: null, error: '' } };
  const sources = [source('campaign', 'bus', { folder: null, live: true }), source('run', 'far', { folder: null, live: true })];
  const cells = [];
  const answers = {
    '/home': await homeOf(sources), '/campaigns/bus': campaign, '/campaigns/bus/attempts': { total: 0, next: null, rows: [] }, '/campaigns/bus/cells': () => { cells.push(1); return Buffer.alloc(0); },
    '/runs/far': runOf('far', { folder: null }),
  };
  await open('/', answers, async (page, push) => {
    await page.locator('nav').getByRole('link', { name: 'Generation' }).click();
    await page.waitForSelector('[data-attempts-summary]');
    await page.waitForURL('**/generation?dataset=bus');
    await page.waitForSelector('[data-elsewhere]');
    assert.equal(cells.length, 0, 'of seeds nothing is known');
    assert.deepEqual(await page.locator('[data-matrix] tbody td').allInnerTexts(), ['plan_failed', '1'], 'the bus knows reasons alone');
    await push('attempts', { campaign: 'another', status: { ...campaign.status, attempts: 99 }, total: 0, rows: [] });
    await push('attempts', { campaign: 'bus', status: { ...campaign.status, attempts: 5 }, total: 0, rows: [] });
    await page.waitForSelector('[data-attempts-summary]:has-text("5 attempts")');
    assert.ok(!(await page.locator('nav').getByRole('link', { name: 'Dataset' }).getAttribute('href')).includes('bus'), 'it has no dataset here');
    for (const name of ['Training', 'Checkpoints', 'Inside']) {
      await page.locator('nav').getByRole('link', { name }).click();
      await page.waitForSelector(`h1:has-text("${name}")`, { state: 'attached' });
      await page.waitForSelector('[data-elsewhere]');
      assert.equal(await page.locator('.problem').count(), 0, name);
    }
    assert.deepEqual(await axe(page), []);
  });
});

const attemptOf = (index, more = {}) => ({ index, attempt: 0, seed: '7', t: '2026-01-01T10:00:00Z', worker: 'w', outcome: 'plan_failed', reason: 'reach: no path', task: 'pick', target: 'cube', robot: 'ur5', stage: 'reach', pair: null,
  plan_s: 1, step_s: 1, render_s: 1, deflate_s: 0, has_pictures: false, replay: null, ...more });
const attemptsOf = (campaign, ...rows) => ({ campaign, total: rows.length, next: null, rows });

test('a campaign that is picked shows nothing of the one before', async () => {
  const failures_by = [['pick', 3], ['', 2]].map(([task, count]) => ({ reason: 'plan_failed', stage: null, task, robot: '', count }));
  const of = (id, attempts) => ({ id, name: id, state: 'running', dataset: id, spec: null, spec_sha256: null, failures: {}, failures_by, timing: null, tasks: ['pick'], robots: [],
    status: { attempts, committed: 0, total: 10, given_up: 0, live: true, per_min: null, eta_s: null, error: '' } });
  const answers = { '/home': await homeOf([source('dataset', 'a'), source('dataset', 'b')]), '/campaigns/a': of('a', 4), '/campaigns/b': of('b', 50) };
  for (const id of ['a', 'b']) Object.assign(answers, { [`/campaigns/${id}/attempts`]: attemptsOf(id, attemptOf(3)), [`/campaigns/${id}/cells`]: tensors({}) });
  await open('/generation?dataset=a', answers, async (page, push) => {
    await push('attempts', { status: { ...of('a', 4).status, attempts: 7 }, total: 0, rows: [] });
    await page.waitForSelector('.pill:has-text("3 new")');
    await page.locator('.pickers select').selectOption('b');
    await page.waitForSelector('[data-attempts-summary]:has-text("50 attempts")');
    assert.equal(await page.locator('.pill').count(), 0, 'new ones are those of this campaign');
    await push('attempts', { campaign: 'a', status: { ...of('a', 4).status, attempts: 99 }, total: 0, rows: [] }, { campaign: 'b' });
    // what is said after it is shown, and it is not
    await push('home', { ...answers['/home'], sentence: 'said after it' });
    await page.waitForSelector('[data-sentence]:has-text("said after it")');
    assert.match(await page.locator('[data-attempts-summary]').innerText(), /50 attempts/);
    await push('attempts', { campaign: 'b', status: { ...of('b', 50).status, attempts: 51 }, total: 0, rows: [] }, { campaign: 'b' });
    await page.waitForSelector('[data-attempts-summary]:has-text("51 attempts")');
    assert.deepEqual(await page.locator('[data-matrix] tbody td.num').allInnerTexts(), ['3', '5'], 'those without a task are in the sum');
  });
});

/** A campaign "a" with its files, and all that is asked of it. */
async function answersOfCampaign(status, rows) {
  const of = { id: 'a', name: 'a', state: 'running', dataset: 'a', spec: null, spec_sha256: null, failures: {}, failures_by: [], timing: null, tasks: [], robots: [],
    status: { attempts: 4, committed: 3, total: 10, given_up: 0, workers: 1, live: true, per_min: 5, eta_s: null, error: '', control: '', age_ms: 0, ...status } };
  return { '/home': await homeOf([source('dataset', 'a')]), '/campaigns/a': of, '/campaigns/a/attempts': () => attemptsOf('a', ...rows()), '/campaigns/a/cells': tensors({}) };
}

test('Generation: a campaign that is held up says so, and offers what makes sense then', async () => {
  const answers = await answersOfCampaign({ control: 'paused' }, () => [attemptOf(3)]);
  const { status } = answers['/campaigns/a'];
  await open('/generation?dataset=a', answers, async (page, push) => {
    const enabled = () => page.locator('button[data-action]').evaluateAll((all) => all.filter((one) => !one.disabled).map((one) => one.dataset.action));
    const chip = page.locator('.page-head .chip');
    await page.waitForSelector('.page-head .chip:has-text("paused")');
    assert.equal(await chip.count(), 1, 'and not that it runs');
    assert.deepEqual(await enabled(), ['drain', 'resume', 'stop']);
    const offered = { draining: ['resume', 'stop'], stopping: [], '': ['pause', 'drain', 'stop'] };
    for (const [control, actions] of Object.entries(offered)) {
      await push('attempts', { campaign: 'a', status: { ...status, control }, total: 4, rows: [] });
      await page.waitForSelector(`.page-head .chip:has-text("${control || 'running'}")`);
      assert.deepEqual(await enabled(), actions, control);
    }
  });
});

test('Generation: a listing without a row follows what comes, and says when filters leave none', async () => {
  let rows = [];
  const answers = await answersOfCampaign({}, () => rows);
  const { status } = answers['/campaigns/a'];
  await open('/generation?dataset=a&task=pick', answers, async (page, push) => {
    await page.waitForSelector('.empty:has-text("No attempt fits these filters")');
    rows = [attemptOf(3)];
    await push('attempts', { campaign: 'a', status: { ...status, attempts: 5 }, total: 5, rows: [] });
    await page.waitForSelector('[aria-label="Attempts"] [role=row][data-id="3.0"]');
    assert.equal(await page.locator('.pill').count(), 0);
    // who reads a listing finds it as it was
    rows = [attemptOf(4), attemptOf(3)];
    await push('attempts', { campaign: 'a', status: { ...status, attempts: 6 }, total: 6, rows: [] });
    await page.locator('.pill:has-text("1 new")').click();
    await page.waitForSelector('[aria-label="Attempts"] [role=row][data-id="4.0"]');
  });
});

test('Generation: a campaign that is made anew is listed anew', async () => {
  let rows = [attemptOf(3)];
  const answers = await answersOfCampaign({}, () => rows);
  const { status } = answers['/campaigns/a'];
  await open('/generation?dataset=a', answers, async (page, push) => {
    await page.waitForSelector('[aria-label="Attempts"] [role=row][data-id="3.0"]');
    rows = [attemptOf(0)];
    await push('attempts', { campaign: 'a', status: { ...status, attempts: 1, committed: 0 }, total: 1, rows: [] });
    await page.waitForSelector('[aria-label="Attempts"] [role=row][data-id="0.0"]');
    assert.equal(await page.locator('.pill').count(), 0);
  });
});

test('Generation: a campaign that was seen on the bus first goes on under the name of its folder', async () => {
  const name = 'a@0123456789abcdef';
  let dataset = null;
  const answers = await answersOfCampaign({}, () => [attemptOf(3)]);
  Object.assign(answers, {
    '/home': await homeOf([source('campaign', name, { folder: null, live: true })]), [`/campaigns/${name}`]: () => ({ ...answers['/campaigns/a'], id: name, dataset }),
    [`/campaigns/${name}/attempts`]: attemptsOf(name), [`/campaigns/${name}/cells`]: tensors({}),
  });
  await open(`/generation?dataset=${name}`, answers, async (page) => {
    await page.waitForSelector('[data-elsewhere]');
    dataset = 'a';
    await page.waitForURL('**/generation?dataset=a', { timeout: 60000 });
    await page.waitForSelector('[aria-label="Attempts"] [role=row][data-id="3.0"]');
    // what the picker has not heard of yet is not taken for one of those that it has
    assert.equal(await page.locator('.pickers option:checked').textContent(), 'a (not listed)');
  });
});

test('Generation: an error without a space is read on the narrowest page', async () => {
  const answers = await answersOfCampaign({ error: `write '/${'long'.repeat(120)}': No space left on device` }, () => []);
  await open('/generation?dataset=a', answers, async (page) => {
    await page.setViewportSize({ width: 360, height: 800 });
    await page.waitForSelector('[data-campaign-error]:has-text("No space left")');
    await drawn(page);
    assert.deepEqual(await overflow(page), []);
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= document.documentElement.clientWidth));
  });
});

test('Training: a run that is trained on again is not told to be', async () => {
  const answers = { '/home': await homeOf([source('run', 'a')]), ...answersOf('a', { path: '/out/a', state: 'failed', step: 150, end: { cause: 'failed', step: 150, t: null } }) };
  await open('/training?run=a', answers, async (page, push) => {
    await page.waitForSelector('.problem:has-text("ended with an error at step 150")');
    await push('train', { run: 'a', state: 'running', step: 150, stage: 1, stages: 2, stage_name: 'LANG', loss: null, samples_per_s: null, data_wait: null, eta_s: null });
    await page.waitForSelector('.problem', { state: 'detached' });
  });
});

test('a range that is none shows all, and a series that does not come says why', async () => {
  let broken = true;
  const answers = {
    '/home': await homeOf([source('run', 'a')]), ...answersOf('a', { keys: [loss], nulls: [{ step: 100, key: 'train/loss' }], nulls_total: 1234 }),
    '/runs/a/series': (url) => {
      assert.equal(url.searchParams.get('from'), null);
      return broken ? { status: 500, json: { title: 'The series cannot be read', status: 500 } } : curve([50, 100, 150], [1, NaN, 0.5]);
    },
  };
  await open('/training?run=a&range=abc', answers, async (page) => {
    await page.waitForSelector('.problem:has-text("The series cannot be read")');
    assert.equal(await page.locator('.skeleton').count(), 0);
    broken = false;
    await page.getByRole('button', { name: 'Try again' }).click();
    // a value that is not finite is said, and is not among those counted
    await page.waitForSelector('[data-chart=Loss] figcaption .bad:has-text("1 not finite")');
    assert.equal(await page.locator('table[data-table=Loss] tr[data-line=train] td').first().textContent(), '2');
    await page.waitForSelector('.chip:has-text("1,234 values not finite")');
    assert.equal(await page.locator('.problem').count(), 0);
  }, { allow: /500 \(Internal/ });
});

test('an address that is not UTF-8, and a page that cannot be drawn, leave the window', async () => {
  await open('/%E0%A4', {}, async (page) => { await page.waitForSelector('text=There is no such page'); });
  const answers = { '/logs': { lines: 3 } };
  await open('/logs', answers, async (page) => {
    await page.waitForSelector('[data-broken] .problem');
    await page.locator('nav').getByRole('link', { name: 'Play' }).click();
    await page.waitForSelector('h1:has-text("Play")', { state: 'attached' });
    assert.equal(await page.locator('[data-broken]').count(), 0);
    await page.locator('nav').getByRole('link', { name: 'Logs' }).click();
    await page.waitForSelector('[data-broken]');
    // nobody clicks: a better answer is found by itself
    answers['/logs'] = { sources: [], lines: [], next: null };
    await page.waitForSelector('main .empty:has-text("No log files")', { timeout: 20000 });
    assert.equal(await page.locator('[data-broken]').count(), 0);
  }, { allow: /could not be drawn/ });
});

test('a gateway that wants another token asks for it; one that is gone is said to be gone', async () => {
  let token = 'old';
  const { page, context } = await openPage(browser, gateway.address);
  try {
    // as a socket that is refused: closed, and nothing is said
    await page.routeWebSocket(/\/api\/v1\/live/, (socket) => { if (token !== 'old') void socket.close(); });
    await page.route('**/api/v1/**', (route) => (token === 'old' ? route.continue() : token === 'gone' ? route.abort() : route.fulfill({ status: 401, json: { title: 'The token is needed', status: 401 } })));
    await page.goto(`${gateway.address}/logs`);
    await page.waitForSelector('main h1', { state: 'attached' });
    token = 'new';
    await page.goto(`${gateway.address}/logs`);
    await page.waitForSelector('[data-sign-in]');
    await page.getByLabel('Token').fill('half a tok');
    // it stays while the socket is tried again
    await page.waitForRequest('**/api/v1/home');
    await page.waitForRequest('**/api/v1/home');
    assert.equal(await page.getByLabel('Token').inputValue(), 'half a tok');
    token = 'gone';
    await page.waitForSelector('.banner');
    token = 'new';
    await page.waitForSelector('[data-sign-in]', { timeout: 20000 });
  } finally {
    await context.close();
  }
});

test('Overview says what goes on before there is a source', async () => {
  const ups = [{ folder: '/out', state: 'running', phase: 'preparing', goal: null, exit: null }];
  const warnings = [{ code: 'disk', text: 'disk on lab-b 2 % free', since: null, link: '/fleet' }];
  await open('/', { '/home': await homeOf([], { ups, warnings }) }, async (page) => {
    await page.waitForSelector('[data-up=running]:has-text("preparing")');
    await page.waitForSelector('[data-code=disk]');
    await page.waitForSelector('.empty');
  });
});

test('a job that the gateway forgot has ended, and single keys do not act behind a dialog', async () => {
  const campaign = { id: 'a', name: 'a', state: 'running', dataset: null, spec: null, spec_sha256: null, failures: {}, failures_by: [], timing: null, tasks: [], robots: [],
    status: { attempts: 1, committed: 0, total: 10, given_up: 0, live: true, per_min: null, eta_s: null, error: '' } };
  let known = true;
  let asked = 0;
  const answers = {
    '/home': await homeOf([source('campaign', 'a', { folder: null })], { actions: true }), '/campaigns/a': campaign, '/campaigns/a/attempts': { total: 0, next: null, rows: [] }, '/session': { enabled: true, authorized: true },
    // the token that was given has expired between the question for the command and the action
    '/actions': () => (++asked === 2 ? { status: 401, json: { title: 'The token is needed', status: 401 } } : { command: 'etude campaign pause a', job: '7' }),
    '/jobs/7': () => (known ? { id: '7', state: 'running', log: [] } : { status: 404, json: { title: 'Not found', status: 404 } }),
  };
  await open('/generation?dataset=a', answers, async (page) => {
    await page.getByRole('button', { name: 'Pause' }).click();
    await page.waitForSelector('dialog[open]');
    await page.keyboard.press('g');
    await page.keyboard.press('l');
    await page.getByRole('button', { name: 'Run it' }).click();
    await page.getByLabel('Token').fill('the new token');
    await page.getByRole('button', { name: 'Run it' }).click();
    await page.waitForSelector('dialog .chip:has-text("running")');
    assert.match(page.url(), /generation/);
    // the campaign has ended meanwhile: the dialog stays to say how its job did
    campaign.status.live = false;
    await page.waitForSelector('button[data-action=pause][disabled]', { state: 'attached', timeout: 15000 });
    known = false;
    await page.waitForSelector('dialog .problem:has-text("does not know this job")');
    assert.equal(await page.locator('dialog .chip').count(), 0);
  }, { allow: /40[14] \((Not Found|Unauthorized)/ });
});

test('Fleet lists what the gateway runs, and asks whoever ends it for the token', async () => {
  let jobs = [{ id: '7', action: 'serve', command: 'etude policy --checkpoint latest.safetensors', state: 'running', started: '2026-01-01T10:00:00Z', ended: null, exit_code: null, progress: null, result: null, log: ['serves'] },
    { id: '6', action: 'verify', command: 'etude dataset verify data', state: 'done', started: '2026-01-01T09:00:00Z', ended: '2026-01-01T09:00:01Z', exit_code: 0, progress: null, result: null, log: [] },
    { id: '5', action: 'eval', command: 'etude eval --out eval', state: 'failed', started: '2026-01-01T09:00:00Z', ended: new Date().toISOString(), exit_code: 3, progress: null, result: null, log: ['begins', 'no space left on device'] },
    { id: '4', action: 'mask', command: 'etude dataset filter data', state: 'failed', started: '2026-01-01T09:00:00Z', ended: '2026-01-01T09:00:01Z', exit_code: 1, progress: null, result: null, log: [] }];
  let asked = 0;
  const answers = {
    '/fleet': fleetOf(['lab-a']), '/jobs': () => ({ jobs }), '/session': { enabled: true, authorized: true },
    '/jobs/7': () => {
      if (++asked === 1) return { status: 401, json: { title: 'The token is needed', status: 401 } };
      jobs = [];
      return { stopped: true };
    },
  };
  await open('/fleet', answers, async (page) => {
    await page.waitForSelector('[data-job=serve]:has-text("etude policy")');
    assert.equal(await page.locator('[data-job]').count(), 2, 'what has ended well, or failed long ago, is not listed');
    assert.match(await page.locator('[data-job=eval]').innerText(), /failed[^]*exit 3[^]*no space left on device/);
    await page.getByRole('button', { name: 'Stop' }).click();
    await page.waitForSelector('[role=alert]:has-text("token is needed")');
    assert.equal(await page.getByRole('button', { name: 'Stop' }).isEnabled(), false);
    await page.getByLabel('Token').fill('the token');
    await page.getByRole('button', { name: 'Stop' }).click();
    await page.waitForSelector('[data-job]', { state: 'detached' });
    assert.equal(asked, 2);
  }, { allow: /401 \(Unauthorized/ });
});

test('Fleet: a second click ends a job at once, and is none by accident', async () => {
  const job = { id: '7', action: 'eval', command: 'etude eval --out eval', state: 'running', stopping: false, started: '2026-01-01T10:00:00Z', ended: null, exit_code: null, progress: null, result: null, log: [] };
  let asked = 0;
  const answers = { '/fleet': fleetOf(['lab-a']), '/jobs': () => ({ jobs: [job] }), '/jobs/7': () => { asked++; job.stopping = true; return { stopped: true }; } };
  await open('/fleet', answers, async (page) => {
    const stop = page.locator('[data-stop]');
    await page.waitForSelector('[data-stop]:text-is("Stop")');
    await stop.evaluate((one) => one.click());
    await page.waitForSelector('[data-stop][disabled]:text-is("Stopping…")');
    await stop.evaluate((one) => one.click());
    await page.waitForSelector('[data-stop]:not([disabled]):text-is("Stopping… end it at once")');
    assert.equal(asked, 1);
    await stop.click();
    await until('the second request', () => asked === 2);
    // another window knows it from the job
    await page.reload();
    await page.waitForSelector('[data-stop]:text-is("Stopping… end it at once")');
  });
});

test('Play: a preview that does not come says why, and a session whose job is unknown has ended', async () => {
  const sessions = { enabled: true, sessions: [], policies: ['run@0123'], campaigns: ['quickstart'] };
  const answers = {
    '/home': await homeOf([], { actions: true }),
    '/play/sessions': sessions, '/scenes/quickstart/0.png': { status: 503, json: { title: 'Another scene is being drawn', status: 503 } },
    '/jobs/9': { status: 404, json: { title: 'Not found', status: 404 } },
  };
  await open('/play', answers, async (page) => {
    await page.getByRole('button', { name: 'Preview' }).click();
    await page.waitForSelector('.problem:has-text("Another scene is being drawn")');
    answers['/play/sessions'] = { ...sessions, session: 'play-9', job: '9' };
    await page.getByRole('button', { name: 'Open', exact: true }).click();
    await page.waitForSelector('[data-ended=play-9]:has-text("does not know this job")');
    await page.goto(`${gateway.address}/play`);
    await page.getByRole('button', { name: 'Preview' }).click();
    await page.waitForSelector('.problem:has-text("Another scene is being drawn")');
    await page.getByLabel('Number').fill('1');
    await page.waitForSelector('.problem', { state: 'detached' });
  }, { allow: /(503|404) \(/ });
});

const cube = { name: 'cube', x: 0.1, y: 0.2, z: 0.03, yaw: 0, half_extent: [0.03, 0.03, 0.03], hidden: false };
/** A play session "s" with this object on its table. */
const playOf = (object, tasks = []) => ({ session: 's', host: 'h', run: 'r@1', phase: 'rest', age_ms: 0, frame: 0, sentence: '', meaning: null, step: 0, max_steps: 0, judge: {}, outcome: '', reason: '', joints: [], waypoints: [], modules: {}, checkpoint_step: 0, policy_ms: 0, speed: 1, attempts: 0, successes: 0,
  scene: { campaign: 'c', robot: 'ur5', index: 0, seed: '1', tasks, objects: [object], table_half_m: 0.6, camera: { width: 4, height: 3, fovy: 1, position: [0, 0, 1], quaternion: [1, 0, 0, 0] } } });

test('Play: what a sentence means that is not known is said, and it is not run as one that nobody judges', async () => {
  const said = [];
  const answers = {
    '/play/sessions': { enabled: true, sessions: [playOf(cube, ['push'])], policies: ['r@2', 'other@3'], campaigns: ['c'], command: '' }, '/play/sessions/s': playOf(cube, ['push']),
    '/play/sessions/s/meaning': { status: 503, json: { title: 'The parser is busy', status: 503 } },
    '/play/sessions/s/commands': (_url, request) => {
      said.push(request.postDataJSON());
      return { accepted: true, refusal: '' };
    },
  };
  await open('/play?session=s&policy=r@1', answers, async (page) => {
    assert.equal(await page.getByRole('combobox', { name: 'Policy', exact: true }).inputValue(), 'r@2', 'its server was started again');
    await page.getByLabel('Sentence').fill('push it');
    await page.waitForSelector('[data-no-meaning]:has-text("The parser is busy")');
    await page.getByRole('button', { name: 'Run', exact: true }).click();
    await page.waitForSelector('[data-not-said]:has-text("The parser is busy")');
    assert.deepEqual(said, []);
    await page.getByRole('combobox', { name: 'Judged by', exact: true }).selectOption('none');
    await page.waitForSelector('[data-not-said]', { state: 'detached' });
    await page.getByRole('button', { name: 'Run', exact: true }).click();
    await until('the sentence', () => said.length > 0);
    assert.deepEqual(said, [{ action: 'say', arguments: { sentence: 'push it', task: '', target: '', reference: '' } }]);
  }, { allow: /503 \(/ });
  answers['/play/sessions/s/meaning'] = { sentence: 'push it', words: [], task: '', target: '', reference: '', why: 'it names no object', words_of: 'training' };
  await open('/play?session=s&sentence=push+it&judge=push,coke', answers, async (page) => {
    const object = page.getByLabel('Object that it is judged by').locator('option');
    await object.first().waitFor({ state: 'attached' });
    assert.deepEqual(await object.allTextContents(), ['cube', 'coke (not here)']);
  });
});

test('Play: an object that is moved by a key that repeats is asked for once, and then where it is to stand in the end', async () => {
  const places = [];
  const held = [];
  const answers = {
    '/play/sessions': { enabled: true, sessions: [playOf(cube)], policies: ['r@1'], campaigns: ['c'], command: '' }, '/play/sessions/s': playOf(cube),
    '/play/sessions/s/commands': async (_url, request) => {
      places.push(request.postDataJSON().arguments.objects[0]);
      await new Promise((go) => held.push(go));
      return { accepted: true, refusal: '' };
    },
  };
  const near = (value, wanted) => Math.abs(value - wanted) < 1e-9;
  await open('/play?session=s', answers, async (page, push) => {
    const object = page.locator('[data-object=cube]');
    const right = async () => -Number(/translate\(([^ ]+)/.exec(await object.getAttribute('transform'))[1]);
    await object.focus();
    for (let i = 0; i < 5; i++) await page.keyboard.press('ArrowRight');
    await until('it to stand where it is wished', async () => near(await right(), 0.05));
    await until('the first request', () => places.length > 0);
    assert.equal(places.length, 1, 'the others wait for the answer');
    assert.ok(near(places[0].x, 0.09), places[0].x);
    held.shift()();
    await until('the newest place', () => places.length === 2);
    assert.ok(near(places[1].x, 0.05) && near(places[1].y, 0.2), JSON.stringify(places[1]));
    answers['/play/sessions/s'] = playOf({ ...cube, x: 0.06 });
    await push('play', answers['/play/sessions/s']);
    held.shift()();
    await until('the place that it is said to have', async () => near(await right(), 0.06));
    assert.equal(places.length, 2);
  });
});

test('Fleet: keys are of the table with the focus, folding is in the address, rows hold still while one is at them', async () => {
  const worker = { worker: 'w0', campaign: 'c', phase: 'idle', index: null, attempt: 0, episodes: 1, failures: 0, per_min: 1, task: null, robot: null, target: null, stage: null, step: null, last: null, strip: '', age_ms: 0 };
  const process = { process: 'p', role: 'collector', pid: 1, rss_mb: 1, cpu: 1, disk_free: null, folder: null, version: '1', age_ms: 0 };
  const fleet = (...names) => ({ ...fleetOf(names), hosts: names.map((name) => ({ ...host(name), slots: 1, workers: [{ ...worker, worker: `${name}-w0` }], processes: [{ ...process, process: `${name} 1` }] })) });
  await open('/fleet', { '/fleet': fleet('lab-a', 'lab-b') }, async (page, push) => {
    const active = () => page.locator('[data-active]').evaluateAll((all) => all.map((one) => one.dataset.id));
    const rows = () => page.locator('[aria-label="Hosts and workers"] [role=row][data-id]').evaluateAll((all) => all.map((one) => one.dataset.id));
    await page.waitForSelector('[role=row][data-id=lab-a]');
    await page.keyboard.press('j');
    await page.waitForSelector('[data-active]');
    assert.deepEqual(await active(), ['lab-a']);
    await page.getByRole('button', { name: 'lab-a' }).click();
    await page.waitForURL('**fold=lab-a');
    assert.deepEqual(await rows(), ['lab-a', 'lab-b', 'lab-b-w0']);
    // the focus is still on the row that was folded
    await page.mouse.move(0, 0);
    await push('fleet', fleet('lab-b', 'lab-a'));
    await page.waitForSelector('[data-held]:has-text("2 rows would move")');
    assert.deepEqual(await rows(), ['lab-a', 'lab-b', 'lab-b-w0']);
    await page.locator('.table[aria-label="Processes"]').focus();
    await page.waitForSelector('[data-held]', { state: 'detached' });
    assert.deepEqual(await rows(), ['lab-b', 'lab-b-w0', 'lab-a']);
    await page.keyboard.press('j');
    await page.waitForSelector('[data-active][data-id="lab-b 1"]');
    await page.reload();
    await page.waitForSelector('[aria-label="Hosts and workers"] [role=row][data-id]');
    assert.deepEqual(await rows(), ['lab-a', 'lab-b', 'lab-b-w0']);
  });
});

test('Fleet: who opened a host finds it open whatever the filter leaves', async () => {
  const worker = { worker: 'lab-a-w0', campaign: 'c', phase: 'idle', index: null, attempt: 0, episodes: 1, failures: 0, per_min: 1, task: null, robot: null, target: null, stage: null, step: null, last: null, strip: '', age_ms: 0 };
  const fleet = (workers) => ({ ...fleetOf(['lab-a'], { workers }), hosts: [{ ...host('lab-a'), slots: 1, workers: [worker] }] });
  await open('/fleet', { '/fleet': fleet(300) }, async (page, push) => {
    const rows = () => page.locator('[aria-label="Hosts and workers"] [role=row][data-id]').evaluateAll((all) => all.map((one) => one.dataset.id));
    await page.waitForSelector('[role=row][data-id=lab-a]');
    assert.deepEqual(await rows(), ['lab-a'], 'folded where there are many');
    await page.getByRole('button', { name: 'lab-a' }).click();
    await page.waitForURL('**open=lab-a');
    assert.deepEqual(await rows(), ['lab-a', 'lab-a-w0']);
    await push('fleet', { ...fleet(100), per_min: 7 });
    await page.waitForSelector('[data-fleet-summary]:has-text("7 a minute")');
    assert.deepEqual(await rows(), ['lab-a', 'lab-a-w0']);
    await page.getByRole('button', { name: 'lab-a' }).click();
    await page.waitForURL('**fold=lab-a');
    assert.equal(new URL(page.url()).searchParams.get('open'), null);
    assert.deepEqual(await rows(), ['lab-a']);
  });
});

test('Training: a goal that is a share of what may be wrong stands at the accuracy', async () => {
  const key = { ...loss, key: 'valid/LANG.accuracy', kind: 'valid', name: 'LANG.accuracy', module: 'LANG', unit: 'share' };
  const values = [0.9, 0.97, 1];
  const curveOf = tensors(Object.fromEntries(['x', 'step', 'min', 'max', 'last'].map((name) => [`${key.key}/${name}`, name === 'x' || name === 'step' ? [50, 100, 150] : values])));
  const goal = { module: 'LANG', goal: 0.01, value: 0, unit: '-', reached: true, key: key.key };
  const answers = { '/home': await homeOf([source('run', 'a')]), ...answersOf('a', { keys: [key], modules: ['LANG'], goals: [goal] }), '/runs/a/series': curveOf };
  await open('/training?run=a', answers, async (page) => {
    const chart = page.locator('[data-chart^="LANG"]');
    await chart.locator('canvas').waitFor();
    assert.equal(await chart.getAttribute('data-goal'), '0.99');
  });
});

test('Training: runs that are overlaid have a shape each, and a chart zooms by keyboard', async () => {
  const answers = { '/home': await homeOf(['a', 'b'].map((id) => source('run', id))) };
  for (const id of ['a', 'b']) Object.assign(answers, answersOf(id, { keys: [loss] }), { [`/runs/${id}/series`]: curve([50, 100, 150, 200], [1, 0.8, 0.6, id === 'a' ? 0.5 : 0.4]) });
  await open('/training?run=a,b', answers, async (page) => {
    const chart = page.locator('[data-chart=Loss]');
    await chart.locator('canvas').waitFor();
    assert.deepEqual(await chart.locator('[data-marker]').evaluateAll((all) => all.map((one) => one.dataset.marker)), ['0', '1']);
    await chart.locator('.plot').focus();
    await page.keyboard.press('End');
    await page.keyboard.press('+');
    await page.waitForURL('**range=**');
    const [from, to] = new URL(page.url()).searchParams.get('range').split('..').map(Number);
    assert.equal(to - from, 75, 'half of it');
    await page.keyboard.press('0');
    await page.waitForURL((url) => !url.searchParams.has('range'));
    await page.keyboard.press('+');
    await page.locator('[data-all]').click();
    await page.waitForURL((url) => !url.searchParams.has('range'));
    assert.deepEqual(await axe(page), []);
  });
});

test('Training: lines that come faster than curves are read end no load', async () => {
  let [told, asked, release] = [0, 0, () => {}];
  const answers = {
    '/home': await homeOf([source('run', 'a')]), ...answersOf('a'), '/runs/a': () => runOf('a', { keys: [{ ...loss, n: ++told }], step: 1000 * told }),
    '/runs/a/series': async () => {
      if (++asked === 1) await new Promise((go) => { release = go; });
      return curve([50, 100], [1, 0.5]);
    },
  };
  await open('/training?run=a', answers, async (page) => {
    const ended = [];
    page.on('requestfailed', (request) => ended.push(request.url()));
    for (const step of ['1,000', '2,000']) await page.waitForSelector(`[data-run-summary] b:text-is("${step}")`);
    await drawn(page);
    assert.deepEqual([asked, ended], [1, []], 'it has not come yet, and is waited for');
    release();
    await page.locator('[data-chart=Loss] canvas').waitFor();
    await until('what has come since', () => asked === 2);
    assert.deepEqual(ended, []);
  });
});

test('of runs that are compared the other pages show the first', async () => {
  const checkpoints = { run: 'a', checkpoints: [], subscribers: [], next_step: null };
  const answers = { '/home': await homeOf(['a', 'b'].map((id) => source('run', id))), ...answersOf('a'), ...answersOf('b'), '/runs/a/checkpoints': checkpoints, '/runs/a/graph': { run: 'a', nodes: [], edges: [], checkpoint: null, architecture: null } };
  await open('/training?run=a,b', answers, async (page) => {
    const address = (name) => page.locator('nav').getByRole('link', { name }).getAttribute('href');
    await page.waitForSelector('[data-run-summary]');
    assert.equal(await address('Training'), '/training?run=a%2Cb');
    assert.deepEqual([await address('Inside'), await address('Checkpoints')], ['/inside?run=a', '/checkpoints?run=a']);
    for (const [path, title] of [['inside', 'No policy is described here'], ['checkpoints', 'Nothing saved yet']]) {
      await page.goto(`${gateway.address}/${path}?run=a,b`);
      await page.waitForSelector(`.empty:has-text("${title}")`);
      assert.equal(await page.locator('.problem').count(), 0, path);
    }
  });
});

const share = (successes, n) => ({ successes, share: n ? successes / n : 0, low: 0.1, high: 0.9 });
const evalOf = (id, successes, n, more = {}) => ({ id, name: id, folder: id, path: `/${id}`, state: 'finished', updated: null, age_ms: 0, campaign: 'c', run: 'r', run_id: 'r', checkpoint: { step: 200, sha256: null, file: null }, seed: '1',
  episodes: n, done: n, per_task: [], overall: { task: 'overall', n, success: share(successes, n) }, modules: [], latency: null, scenes: null, extra: {}, dataset: null, insights: 0, spec: null, ...more });
const rolloutOf = (index, success, more = {}) => ({ index, seed: '1', task: 'pick', target: 'cube', reference: '', robot: '', instruction: 'pick it up', success, success_latched: success, outcome: success ? 'success' : 'timeout',
  violations: [], disturbed_objects: [], steps: 9, decisions: 3, latency_steps: 0, checkpoint_step: 200, error_cm: {}, error_before_contact_cm: {}, video: null, insight: false, ...more });
const rolloutsOf = (...rows) => ({ total: rows.length, failed: rows.filter((one) => !one.success).length, next: null, rows });

test('Evaluation: of one that is over nothing is still to come', async () => {
  let state = 'running';
  const answers = { '/home': await homeOf([source('eval', 'a'), source('run', 'r')]), '/evals/a': () => evalOf('a', 2, 3, { episodes: 4, state }), '/evals/a/rows': () => rolloutsOf(rolloutOf(0, true), rolloutOf(1, true), rolloutOf(2, false)) };
  await open('/evaluation?eval=a', answers, async (page) => {
    await page.waitForSelector('[data-eval-summary]:has-text("1 to go")');
    await page.waitForSelector('.seeds .open', { state: 'attached' });
    state = 'finished';
    await page.reload();
    await page.waitForSelector('[data-eval-summary]:has-text("1 given up")');
    await page.waitForSelector('[data-scene="2"]');
    assert.equal(await page.locator('.seeds .open').count(), 0);
  });
});

test('Evaluation: of the scene that is picked alone something is shown, and what nobody picked stays', async () => {
  let [rows, one] = [[rolloutOf(3, false), rolloutOf(0, true)], () => rolloutsOf()];
  const answers = { '/home': await homeOf([source('eval', 'a'), source('run', 'r')]), '/evals/a': evalOf('a', 1, 2, { episodes: 9 }), '/evals/a/rows': (url) => (url.searchParams.has('index') ? one() : rolloutsOf(...rows)) };
  const problem = { status: 500, json: { title: 'The rows cannot be read', status: 500 } };
  const panel = (index) => `section[aria-label="Scene ${index}"]`;
  await open('/evaluation?eval=a&scene=7', answers, async (page) => {
    await page.waitForSelector(`${panel(7)} [data-no-scene]`);
    assert.equal(await page.locator('[aria-current][data-scene]').count(), 0, 'another one is not shown in its place');
    one = () => problem;
    await page.reload();
    await page.waitForSelector(`${panel(7)} .problem:has-text("cannot be read")`);
    one = () => rolloutsOf(rolloutOf(7, true));
    await page.getByRole('button', { name: 'Try again' }).click();
    await page.waitForSelector(`${panel(7)} :text("pick it up")`);
  }, { allow: /500 \(Internal/ });
  await open('/evaluation?eval=a', answers, async (page, push) => {
    await page.waitForSelector(panel(3));
    rows = [rolloutOf(1, false), ...rows];
    await push('eval', evalOf('a', 1, 3, { episodes: 9 }));
    await page.waitForSelector('[data-scene="1"]');
    await drawn(page);
    assert.equal(await page.locator(panel(3)).count(), 1);
    assert.equal(await page.locator('[data-scene][aria-current]').getAttribute('data-scene'), '3');
    // videos and what the policy said are written when the last rollout is over
    rows = rows.map((one) => (one.index === 3 ? rolloutOf(3, false, { insight: true, video: '/x.mp4' }) : one));
    await push('eval', evalOf('a', 1, 3, { episodes: 9, updated: '2026-01-01T10:01:00Z' }));
    await page.waitForSelector(`${panel(3)} a:has-text("What the policy said")`);
    await page.waitForSelector(`${panel(3)} video[src="/x.mp4"]`, { state: 'attached' });
    // its folder is made anew: nothing of the rollouts before is shown
    rows = [rolloutOf(0, true)];
    await push('eval', evalOf('a', 1, 1, { episodes: 9, updated: '2026-01-01T10:02:00Z' }));
    await page.waitForSelector(panel(3), { state: 'detached' });
  }, { allow: /404 \(Not Found|Failed to load/ });
});

test('runs of one name are told apart where they are compared', async () => {
  const runs = ['x', 'y'].map((folder) => source('run', `${folder}.run`, { name: 'run', folder: `${folder}/run` }));
  await open('/training?run=x.run', { '/home': await homeOf(runs), ...answersOf('x.run'), ...answersOf('y.run') }, async (page) => {
    await page.waitForSelector('option:has-text("run (y/run)")', { state: 'attached' });
  });
});

test('Fleet without a worker lists what the gateway runs, and asks again beside its channel', async () => {
  const job = { id: '7', action: 'eval', command: 'etude eval --out eval', state: 'running', started: '2026-01-01T10:00:00Z', ended: null, exit_code: null, progress: null, result: null, log: [] };
  let fleet = { status: 504, json: { title: 'Took too long', status: 504 } };
  await open('/fleet', { '/fleet': () => fleet, '/jobs': { jobs: [job] }, '/session': { enabled: true, authorized: true } }, async (page) => {
    await page.waitForSelector('.problem:has-text("Took too long")');
    fleet = fleetOf([], { workers: 0, live: false });
    await page.waitForSelector('.empty:has-text("No worker has been heard")', { timeout: 15000 });
    await page.waitForSelector('[data-job=eval]');
    assert.equal(await page.locator('.problem').count(), 0);
  }, { allow: /504 \(Gateway/ });
});

test('what other evaluations say is read again when they have changed', async () => {
  const sources = (updated) => ['a', 'b'].map((id) => source('eval', id, { updated: id === 'b' ? updated : null })).concat(source('run', 'r'));
  const node = { name: 'CTRL', level: 1, entity: 'ee', quantity: 'trajectory', reads: ['image'], query: '', attend: [], inputs: [], from: [], between: [], relative_to: '', detach: false, parameters: 1, error: null, trained_steps: null, stage: null, trained: false, frozen: false };
  const answers = {
    '/home': await homeOf(sources('2026-01-01T10:00:00Z')), '/evals/a': evalOf('a', 1, 2), '/evals/a/rows': rolloutsOf(rolloutOf(0, true)), '/evals/b': evalOf('b', 1, 4), ...answersOf('r'),
    '/runs/r/graph': { checkpoint: null, architecture: null, inputs: ['image'], nodes: [node], edges: [], columns: [['image'], ['CTRL']] },
    '/evals/b/rows': rolloutsOf(rolloutOf(5, false, { insight: true })), '/evals/b/insights/5': { status: 500, json: { title: 'Its file is gone', status: 500 } },
  };
  await open('/evaluation?eval=a', answers, async (page, push) => {
    await page.waitForSelector('[data-by-checkpoint] .dot-row:has-text("1 of 4")');
    answers['/evals/b'] = evalOf('b', 3, 8);
    await push('home', await homeOf(sources('2026-01-01T10:01:00Z')));
    await page.waitForSelector('[data-by-checkpoint] .dot-row:has-text("3 of 8")');
  });
  const from = (page) => page.getByRole('combobox', { name: 'from', exact: true });
  await open('/inside?run=r', answers, async (page, push) => {
    await page.waitForSelector('[data-node=CTRL]');
    assert.equal(await from(page).count(), 0);
    answers['/evals/b'] = evalOf('b', 3, 8, { insights: 1 });
    await push('home', await homeOf(sources('2026-01-01T10:02:00Z')));
    await from(page).locator('option', { hasText: 'files of b' }).waitFor({ state: 'attached' });
  }, { allow: /404 \(Not Found/ });
  await open('/inside?run=r&eval=b', answers, async (page, push) => {
    const rollout = page.getByRole('combobox', { name: 'rollout', exact: true });
    await rollout.locator('option', { hasText: '#5' }).waitFor({ state: 'attached' });
    answers['/evals/b'] = evalOf('b', 3, 9, { insights: 2 });
    answers['/evals/b/rows'] = rolloutsOf(rolloutOf(6, false, { insight: true }), rolloutOf(5, false, { insight: true }));
    await push('home', await homeOf(sources('2026-01-01T10:03:00Z')));
    await rollout.locator('option', { hasText: '#6' }).waitFor({ state: 'attached' });
    assert.equal(await rollout.inputValue(), '5', 'what is walked through stays');
  }, { allow: /500 \(Internal/ });
});

test('Checkpoints: what is looked at stays, and what is not kept says so', async () => {
  const checkpoint = (step, more = {}) => ({ file: `${String(step).padStart(8, '0')}.safetensors`, step, stage: 1, stages: 2, stage_name: 'LANG', bytes: 1000, modified: '2026-01-01T10:00:00Z', sha256: 'ab'.repeat(32), channels: [], metrics: {}, parameters: {},
    modules: { LANG: { quantity: 'class', trained_steps: 5, error: 0.25 }, TAR2D: { quantity: 'pixel', trained_steps: 5, error: 1.5 }, TAR3D: { quantity: 'position', trained_steps: 5, error: 0.02 } },
    dataset: null, architecture: null, robot: null, joints: null, train_episodes: null, version: null, run: null, control_trained: true, refused: null, error: null, served_by: [], ...more });
  let rows = [checkpoint(100)];
  const answers = { '/home': await homeOf([source('run', 'a')]), ...answersOf('a'), '/runs/a/checkpoints': () => ({ run: 'a', checkpoints: rows, next_step: null, subscribers: [] }), '/actions': { command: 'etude eval', job: null }, '/session': { enabled: false, authorized: false } };
  const panel = 'section[aria-label="00000100.safetensors"]';
  await open('/checkpoints?run=a', answers, async (page, _push, drop) => {
    await page.waitForSelector(panel);
    assert.deepEqual(await page.locator('[aria-label="Modules of this checkpoint"] tbody td:nth-child(2)').allInnerTexts(), ['25 % wrong', '1.5 px', '2 cm']);
    await page.getByRole('button', { name: 'Evaluate' }).click();
    await page.waitForSelector('dialog[open] .command:has-text("etude eval")');
    // asked again as soon as the gateway is back
    for (const steps of [[200, 100], [300, 200]]) {
      rows = steps.map((step) => checkpoint(step));
      await drop();
      await page.waitForSelector(`[role=row][data-id="${rows[0].file}"]`, { state: 'attached' });
      await drawn(page);
      assert.equal(await page.locator(panel).count(), 1, `${steps}`);
      assert.equal(await page.locator('dialog[open]').count(), 1, `${steps}`);
      assert.equal(await page.locator(`${panel} .chip:has-text("no longer kept")`).count(), steps.includes(100) ? 0 : 1);
    }
    await page.getByRole('button', { name: 'Close' }).click();
    assert.equal(await page.getByRole('button', { name: 'Evaluate' }).isEnabled(), false);
  });
  await open('/checkpoints?run=a&file=00000100.safetensors', answers, async (page) => {
    await page.waitForSelector('[data-not-kept]:has-text("00000100.safetensors is not kept")');
  });
});

test('Checkpoints: the scenes of an evaluation are chosen, and what does not fit is said', async () => {
  const one = { file: '00000100.safetensors', step: 100, stage: 1, stages: 2, stage_name: 'LANG', bytes: 1000, modified: '2026-01-01T10:00:00Z', sha256: null, channels: [], metrics: {}, parameters: {}, modules: {},
    dataset: null, architecture: null, robot: 'panda', joints: null, train_episodes: null, version: null, run: null, control_trained: true, refused: null, error: null, served_by: [] };
  const answers = { '/home': await homeOf([source('run', 'a')]), ...answersOf('a'), '/runs/a/checkpoints': { run: 'a', checkpoints: [one], next_step: null, subscribers: [] },
    '/play/sessions': { enabled: true, sessions: [], policies: [], campaigns: ['obstacle', 'panda'] }, '/session': { enabled: false, authorized: false },
    '/actions': (_url, request) => {
      const { scenes } = request.postDataJSON();
      return scenes === 'panda' ? { command: 'etude eval --scenes panda.yaml', job: null } : { status: 400, json: { title: 'The request is wrong', status: 400, detail: `scenes: not ${scenes ?? 'those'}` } };
    } };
  await open('/checkpoints?run=a', answers, async (page) => {
    await page.getByRole('button', { name: 'Evaluate' }).click();
    await page.waitForSelector('dialog[open]:has-text("scenes: not those")');
    const choice = page.getByRole('combobox', { name: 'Scenes', exact: true });
    await choice.selectOption('obstacle');
    await page.waitForSelector('dialog[open]:has-text("scenes: not obstacle")');
    assert.equal(await page.locator('dialog[open] .command').count(), 0);
    await choice.selectOption('panda');
    await page.waitForSelector('dialog[open] .command:has-text("--scenes panda.yaml")');
    assert.equal(await page.locator('dialog[open]:has-text("scenes: not")').count(), 0);
  }, { allow: /400 \(Bad Request/ });
  answers['/play/sessions'] = { status: 503, json: { title: 'The bus cannot be joined', status: 503 } };
  await open('/checkpoints?run=a', answers, async (page) => {
    await page.getByRole('button', { name: 'Evaluate' }).click();
    await page.waitForSelector('dialog[open] [role=alert]:has-text("did not come: The bus cannot be joined")');
  }, { allow: /(400|503) \(/ });
});

const episodeColumns = ['index', 'task', 'target', 'robot', 'instruction', 'steps', 'draws', 'odd', 'split', 'success', 'outcome'];

/** All that is asked of a dataset "a", of which `summary` says something else. */
async function answersOfDataset(summary = {}) {
  const columns = Object.fromEntries(episodeColumns.map((name) => [name, [name === 'index' ? 7 : null]]));
  return {
    '/home': await homeOf([source('dataset', 'a')]),
    '/datasets/a': { id: 'a', name: 'a', folder: 'out/a', path: '/home/lab/out/a', role: 'demonstrations', eval: null, state: 'finished', updated: null, age_ms: null, identity: null, schema_version: 1, content: 1, spec: {}, spec_sha256: '', statistics: {},
      episodes: 3, total: 3, failed_attempts: {}, unreadable: 0, unreadable_files: [], journal: true, keys: [], cameras: [], bytes: 1 },
    '/datasets/a/episodes': { total: 1, all: 1, known: 1, next: null, columns },
    '/datasets/a/summary': { total: 3, tasks: {}, targets: {}, robots: {}, outcomes: {}, splits: {}, workers: {}, words: [], matrix: [], odd: [], lengths: { edges_steps: [0, 1], counts: [3] }, places: { x_m: [0, -0.1, 0.1], y_m: [0.3, 0.3, 0.3], task: ['pick', 'pick', 'push'], index: [4, 5, 6] }, ...summary },
  };
}

test('Dataset: while it is collected, a cell is held against the others and not against the whole dataset', async () => {
  const cell = (task, count) => ({ task, target: 'coke', count, expected: 100 });
  const answers = await answersOfDataset({ matrix: [cell('pick', 10), cell('push', 11), cell('put_down', 9)] });
  await open('/dataset?dataset=a', answers, async (page) => {
    const table = page.locator('[data-task-target]');
    await table.waitFor();
    assert.deepEqual(await table.locator('tbody td span').allInnerTexts(), ['10', '11', '9']);
    assert.equal(await table.locator('.warn').count(), 0);
    assert.equal(await table.locator('td[title]').first().getAttribute('title'), 'expected 10 of these');
  }, { allow: /404 \(Not Found/ });
  const uneven = await answersOfDataset({ matrix: [cell('pick', 40), cell('push', 5), cell('put_down', 45)] });
  await open('/dataset?dataset=a', uneven, async (page) => {
    await page.waitForSelector('[data-task-target]');
    assert.deepEqual(await page.locator('[data-task-target] .warn').allInnerTexts(), ['5']);
  }, { allow: /404 \(Not Found/ });
});

test('Inside: a dataset without an episode says so, and the first one that comes is asked about', async () => {
  const columns = (index) => Object.fromEntries(episodeColumns.map((name) => [name, index]));
  let there = [];
  const node = { name: 'CTRL', level: 1, entity: 'ee', quantity: 'trajectory', reads: ['image'], query: '', attend: [], inputs: [], from: [], between: [], relative_to: '', detach: false, parameters: 1, error: null, trained_steps: null, stage: null, trained: false, frozen: false };
  const graph = { checkpoint: null, architecture: null, inputs: ['image'], nodes: [node], edges: [{ from: 'image', to: 'CTRL', kind: 'register' }], columns: [['image'], ['CTRL']] };
  const answers = {
    '/home': await homeOf([source('run', 'r'), source('dataset', 'a')]), ...answersOf('r'), '/runs/r/graph': graph,
    '/datasets/a/episodes': () => ({ total: there.length, all: there.length, known: there.length, next: null, columns: columns(there) }),
  };
  await open('/inside?run=r&dataset=a', answers, async (page) => {
    await page.waitForSelector('main :text("no episode yet")');
    there = [7];
    const asked = page.waitForRequest('**/datasets/a/episodes/7');
    await asked;
  }, { allow: /404 \(Not Found/ });
  const gone = { ...answers, '/datasets/a/episodes': { status: 404, contentType: 'application/problem+json', body: JSON.stringify({ title: 'Not Found', status: 404, detail: 'there is no dataset a' }) } };
  await open('/inside?run=r&dataset=a', gone, async (page) => {
    await page.waitForSelector('main :text("there is no dataset a")');
  }, { allow: /404 \(Not Found/ });
});

test('Dataset: a place is gone to by arrow keys, and the command names the absolute folder', async () => {
  const answers = await answersOfDataset();
  await open('/dataset?dataset=a', answers, async (page) => {
    assert.equal(await page.locator('.command code').first().innerText(), 'etude dataset info /home/lab/out/a');
    const places = page.locator('.places');
    await places.focus();
    await page.keyboard.press('Home');
    await page.keyboard.press('ArrowRight');
    assert.match(await page.locator('[data-place-at]').innerText(), /^#5: pick at x -0.10/);
    await page.keyboard.press('ArrowLeft');
    await page.keyboard.press('ArrowLeft');
    assert.equal(await page.locator('[data-place]').getAttribute('data-place'), '6');
    assert.deepEqual(await axe(page), []);
    await page.keyboard.press('Enter');
    await page.waitForURL('**/episode/a/6');
  }, { allow: /404 \(Not Found/ });
});

test('by keyboard: one skips to the page, the focus follows to the next, and age is not said twice a second', async () => {
  await open('/', {}, async (page) => {
    await page.keyboard.press('Tab');
    assert.equal(await page.evaluate(() => document.activeElement.textContent), 'Skip to the page');
    await page.keyboard.press('Enter');
    assert.equal(await page.evaluate(() => document.activeElement.id), 'main');
    await page.locator('nav').getByRole('link', { name: 'Logs' }).focus();
    await page.keyboard.press('Enter');
    await page.waitForURL('**/logs');
    await page.waitForFunction(() => document.activeElement.id === 'main');
    const said = await page.locator('.connection [role=status]').innerText();
    assert.match(said, /^The gateway is (heard|silent)$/);
    assert.deepEqual(await axe(page), []);
  });
});

test('Logs: an error that the documentation knows says what to do', async () => {
  const line = (n, level, text) => ({ source: 's', n, t: '12:00:00', at: '2026-01-23T11:00:00Z', level, text });
  const logs = { sources: [{ id: 's', name: 'collector.log', bytes: 10, updated: '' }], next: null, searched: 12, back_to: '2026-11-23T06:00:00Z', lines: [line(1, 'info', 'all is well'), line(2, 'error', "campaign.yaml: unknown key 'epsiodes': did you mean 'episodes'? (x)")] };
  await open('/logs', { '/logs': logs }, async (page) => {
    const advice = page.locator('.log li').nth(1).locator('[data-advice]');
    await advice.locator('summary').click();
    assert.match(await advice.innerText(), /nothing was started/);
    await advice.locator('.command code', { hasText: 'etude config describe campaign' }).waitFor();
    assert.equal(await page.locator('[data-advice]').count(), 1);
    assert.match(await page.locator('[data-back-to]').innerText(), /^12 files, back to 2026-11-23 .*were searched/);
    assert.match(await page.locator('.log li').first().innerText(), /^2026-01-23 /, 'in the zone and with the day of all other times');
    assert.deepEqual(await axe(page), []);
  });
});

test('Logs: who stops following keeps what was shown, and not what the page began with', async () => {
  const logs = (...lines) => ({ sources: [{ id: 's', name: 'collector.log', bytes: 10, updated: '' }], next: null, searched: 1, back_to: null, lines: lines.map((text, n) => ({ source: 's', n, t: '12:00:00', at: null, level: 'info', text })) });
  await open('/logs', { '/logs': logs('of the morning') }, async (page, push) => {
    await page.waitForSelector('.log li:has-text("of the morning")');
    await push('logs', logs('of the morning', 'of noon'));
    await page.waitForSelector('.log li:has-text("of noon")');
    await page.getByLabel('follow').uncheck();
    // heard behind it, so that the page has drawn what it shows now
    await push('events', { total: 1, events: [{ process: 'p', n: 1, level: 'warn', t: '2026-01-01T10:00:00Z', role: 'worker', host: 'h', text: 'a warning' }] });
    await page.waitForSelector('[data-events]');
    assert.equal(await page.locator('.log-box li:has-text("of noon")').count(), 1);
    await page.getByLabel('follow').check();
    await push('logs', logs('of the morning', 'of noon', 'of the evening'));
    await page.waitForSelector('.log li:has-text("of the evening")');
  });
});

test('Logs: older lines that do not come leave the filters, and a way to the newest', async () => {
  const logs = { sources: [{ id: 's', name: 'collector.log', bytes: 10, updated: '' }], next: '1-2', lines: [{ source: 's', n: 1, t: '12:00:00', at: null, level: 'info', text: 'all is well' }] };
  const answers = { '/logs': (url) => (url.searchParams.has('before') ? { status: 500, json: { title: 'The file is gone', status: 500 } } : logs) };
  await open('/logs', answers, async (page) => {
    await page.getByRole('button', { name: 'Older lines' }).click();
    await page.waitForSelector('.problem:has-text("The file is gone")');
    assert.equal(await page.getByLabel('Source').locator('option').count(), 2, 'the files are known still');
    await page.locator('[data-newest]').click();
    await page.waitForSelector('.log li:has-text("all is well")');
    assert.equal(await page.locator('.problem, [data-newest]').count(), 0);
  }, { allow: /500 \(Internal/ });
});

test('a replay is followed to its end, also where one question of it fails', async () => {
  const job = (state, log) => ({ id: 'j', action: 'replay', command: 'etude attempt replay', state, started: '2026-01-01T10:00:00Z', ended: null, exit_code: null, progress: null, result: null, log: [log] });
  const said = [job('running', 'step 10'), { status: 504, json: { title: 'The gateway is busy', status: 504 } }, job('running', 'step 20'), job('done', 'step 30')];
  let asked = 0;
  const answers = {
    '/home': await homeOf([source('dataset', 'data')]), '/campaigns/data/attempts': attemptsOf('data', attemptOf(3)),
    '/datasets/data/episodes/3/replay': () => (asked < said.length ? { id: 'replay.x', state: 'running', why_not: null, job: 'j', has_episode: false } : { id: null, state: 'impossible', why_not: 'it was followed', job: null, has_episode: false }),
    '/jobs/j': () => said[Math.min(asked++, said.length - 1)],
  };
  await open('/episode/data/3?attempt=0', answers, async (page) => {
    await page.waitForSelector('[data-replay=running]:has-text("step 10")');
    await page.waitForSelector('[data-replay=running]:has-text("step 20")');
    await page.waitForSelector('text=it was followed');
    assert.equal(asked, said.length);
  }, { allow: /504 \(Gateway|404 \(Not Found/ });
});

test('an episode stays where it was looked at, and its view in space as it was turned, while the gateway comes back', async () => {
  const steps = 200;
  const episode = { dataset: 'a', index: 7, attempt: 0, seed: '7', campaign: 'c', robot: 'ur5', task: 'pick', target: 'cube', reference: '', obstacle: null, instruction: 'pick it up', success: true, outcome: 'success', split: 'train', spec_sha256: '', scene_sha256: '', version: '1',
    steps, duration_s: 10, control_rate_hz: 20, image_stride: 5, bytes: 1, stages: [{ name: 'reach', from: 0, to: steps }], unsupervised: [], objects: [], tracks: [], cameras: [], details: {}, previous: null, next: null, worker: null, host: null, t: null };
  const asked = { episode: 0, tracks: 0 };
  const answers = {
    ...await answersOfDataset(), '/datasets/a/episodes/7': () => { asked.episode++; return episode; },
    '/datasets/a/episodes/7/tracks': () => { asked.tracks++; return tensors({ eef_pos: Array.from({ length: 3 * steps }, (_one, i) => 0.01 * (i % 7)) }); },
    '/datasets/a/episodes/7/replay': { id: null, state: 'impossible', why_not: 'it cannot be made again', job: null, has_episode: false },
  };
  await open('/episode/a/7', answers, async (page, _push, drop) => {
    const shown = async () => Number(/step (\d+) of 200/.exec(await page.locator('[data-time]').innerText())[1]);
    const named = () => Number(new URL(page.url()).searchParams.get('step') ?? 0);
    await page.waitForSelector('.view3d canvas');
    await page.locator('.view3d canvas').evaluate((one) => { one.dataset.turned = 'yes'; });
    await page.keyboard.press('Space');
    await until('it to play', async () => (await shown()) > 3);
    await page.keyboard.press('Space');
    await page.waitForURL('**step=*');
    assert.equal(named(), await shown());
    // browsers refuse to change it many times a second
    await page.evaluate(() => {
      const own = history.replaceState.bind(history);
      globalThis.changes = 0;
      history.replaceState = (...all) => { globalThis.changes++; own(...all); };
    });
    for (let i = 0; i < 30; i++) await page.keyboard.press('ArrowRight');
    await until('the address to follow', async () => named() === await shown());
    assert.ok(await page.evaluate(() => globalThis.changes) < 20, 'as often as keys were pressed');
    // while it is dragged the address has not heard of it
    await page.locator('input[type=range]').evaluate((one) => { one.value = '40'; one.dispatchEvent(new Event('input', { bubbles: true })); });
    assert.equal(await shown(), 40);
    const before = { ...asked };
    await drop();
    await until('both to be read again', () => asked.episode > before.episode && asked.tracks > before.tracks);
    await page.waitForSelector('.banner', { state: 'detached' });
    await drawn(page);
    assert.equal(await shown(), 40);
    assert.equal(await page.locator('.view3d canvas[data-turned]').count(), 1);
  }, { allow: /404 \(Not Found/ });
});
