// SPDX-License-Identifier: Apache-2.0
// The pages over what goes on now, in Debian's Chromium: demonstrations that are committed while a page is open, a policy
// that is asked about a recorded picture, and a play session from the first word to the judge's.
// ETUDE_LAB: what make_lab.mjs made. ETUDE_DOMAIN: a DDS domain of its own. ETUDE_SHOTS: a folder for pictures of Play.
import assert from 'node:assert/strict';
import { execFile } from 'node:child_process';
import { mkdirSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { after, before, test } from 'node:test';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { promisify } from 'node:util';
import { axe, launch, lookAt, openPage, overflow, settle, themes, visit } from './browser.mjs';
import { checkpointHeader, checkpoints, episodeFiles, readJson } from './files.mjs';
import { startGateway } from './gateway.mjs';
import { bin, onDomain, root, startEtude } from './programs.mjs';

const lab = resolve(process.env.ETUDE_LAB ?? '.');
const work = mkdtempSync(join(tmpdir(), `etude-test-${process.pid}-`));
const growing = join(work, 'live', 'growing');
const token = 'a token of some length';
let gateway;
let browser;
let policy;

before(async () => {
  assert.ok(onDomain.length, 'ETUDE_DOMAIN names no domain');
  mkdirSync(join(work, 'live'));
  writeFileSync(join(work, 'token'), token, { mode: 0o600 });
  gateway = await startGateway([lab, join(work, 'live')], 0, [...onDomain, '--token-file', join(work, 'token'), '--cache', join(work, 'cache')]);
  browser = await launch();
});

after(async () => {
  await browser?.close();
  await policy?.stop();
  await gateway?.stop();
  rmSync(work, { recursive: true, force: true });
});

const get = async (path) => (await fetch(`${gateway.address}/api/v1${path}`)).json();
const numberIn = (text) => Number(text.replaceAll(',', ''));

/** Asks again until the answer is true; what it was asked for is in the error. */
async function until(what, ask, limit = 60000) {
  const end = Date.now() + limit;
  for (;;) {
    const answer = await ask();
    if (answer) return answer;
    assert.ok(Date.now() < end, `waited ${limit / 1000} s for ${what}`);
    await new Promise((done) => setTimeout(done, 100));
  }
}

const open = (address, look, options) => lookAt(browser, gateway, address, look, options);

/** Ticks two episodes and saves them as a filter key: the dataset has it, and the page filters by it. */
async function ticksBecomeAKey(dataset, key) {
  const chosen = episodeFiles(growing).slice(0, 2).map((name) => parseInt(name, 10));
  await open(`/dataset?dataset=${dataset.id}&sort=index`, async (page) => {
    const box = (index) => page.locator(`[role=row][data-id="${index}"] input[type=checkbox]`);
    for (const index of chosen) await box(index).check();
    await page.reload();
    await settle(page);
    for (const index of chosen) assert.ok(await box(index).isChecked(), 'ticks are in the address');
    assert.equal(numberIn(await page.locator('[data-ticked] b').innerText()), chosen.length);
    await page.getByLabel('Name of the filter key').fill(key);
    assert.deepEqual(await axe(page), []);
    await page.getByRole('button', { name: 'Save as a key' }).click();
    assert.match(await page.locator('dialog .command code').innerText(), new RegExp(`etude dataset filter .* --as ${key}`));
    await page.getByLabel('Token').fill(token);
    await page.getByRole('button', { name: 'Run it' }).click();
    await page.waitForSelector('dialog .chip:is(.good, .bad)', { timeout: 90000 });
    assert.equal(await page.locator('dialog .chip').innerText(), 'done', await page.locator('dialog').innerText());
    assert.deepEqual(readJson(join(growing, 'filters.json'))[key], chosen);
    await page.getByRole('button', { name: 'Close' }).click();
    await page.locator('select', { has: page.locator('option', { hasText: new RegExp(`^${key}$`) }) }).selectOption(key, { timeout: 30000 });
    await until('the rows of the key', async () => (await page.locator('[data-total]').innerText()).startsWith(`${chosen.length} of `));
    assert.deepEqual(await page.locator('[role=row][data-id]').evaluateAll((all) => all.map((one) => Number(one.dataset.id))), chosen);
  });
}

test('a page that is open follows what is committed, and ends at what lies in the folder', { timeout: 300000 }, async () => {
  const collector = startEtude('collect', 'deploy/campaigns/quickstart.yaml', '--out', growing, '--set', 'name=growing', '--episodes', '500', '--seed', '11', '--workers', '1');
  try {
    await until('the first episode', () => episodeFiles(growing).length > 0);
    const dataset = await until('the gateway to find the dataset', async () => (await get('/home')).sources.find((one) => one.kind === 'dataset' && one.name === 'growing'));
    await open('/fleet', async (page) => {
      await page.waitForFunction(() => / 1 worker/.test(document.querySelector('[data-fleet-summary]')?.textContent ?? ''), undefined, { timeout: 30000 });
      assert.deepEqual(await axe(page), []);
    });
    await open('/topics', async (page) => {
      await page.waitForSelector('[role=row][data-id="etude/campaign/status"]', { timeout: 30000 });
      assert.deepEqual(await axe(page), []);
      assert.deepEqual(await overflow(page), []);
    });
    await areTheTopicsOfTheBus();
    await open(`/dataset?dataset=${dataset.id}`, async (page) => {
      const shown = async () => numberIn(await page.locator('[data-dataset-summary] b').first().innerText());
      const first = await shown();
      assert.ok(first > 0);
      await until('the page to count more', async () => (await shown()) > first);
      await page.waitForSelector('.pill');
      await ticksBecomeAKey(dataset, 'while-it-grows');
      await collector.stop('SIGINT');
      const files = episodeFiles(growing).length;
      await until(`the page to count ${files}`, async () => (await shown()) === files);
      await page.locator('.pill').click();
      await ticksBecomeAKey(dataset, 'afterwards');
      await until(`${files} rows`, async () => numberIn((await page.locator('[data-total]').innerText()).split(' ')[0]) === files);
    });
  } finally {
    await collector.stop('SIGINT');
  }
});

const execute = promisify(execFile);

/** Types and writers are those that another program finds, which reads the bus itself. The gateway does not list its own. */
async function areTheTopicsOfTheBus() {
  const { stdout } = await execute(join(bin, 'etude'), ['topic', 'list', '--json', ...onDomain], { cwd: root, maxBuffer: 1 << 24 });
  const others = (peers) => peers.map((one) => one.peer).filter((peer) => !peer.startsWith('gateway '));
  const found = JSON.parse(stdout).map((one) => ({ ...one, writers: others(one.writers) })).filter((one) => one.writers.length);
  const status = found.find((one) => one.topic === 'etude/campaign/status') ?? assert.fail(stdout);
  assert.match(status.writers.join(), /^(collector|etude collect) \d+@/);
  await open(`/topics?topic=${encodeURIComponent(status.topic)}`, async (page) => {
    const fact = (name) => page.locator('.facts dt', { hasText: new RegExp(`^${name}$`) }).first().locator('xpath=following-sibling::dd[1]');
    await until('the names of those who write', async () => (await fact('writers').innerText()).trim() === [...status.writers].sort().join('\n'));
    assert.equal(await fact('type').innerText(), status.types.join(', '));
    for (const one of (await fact('QoS').innerText()).split('; ')) assert.ok(status.qos.includes(one), `${one}, not one of ${status.qos.join('; ')}`);
    for (const { topic, writers } of found) {
      const cell = page.locator(`[role=row][data-id="${topic}"] [data-column="writers"]`);
      await until(`${writers.length} writers of ${topic}`, async () => numberIn(await cell.innerText()) === writers.length);
    }
    const total = numberIn(await page.locator('[data-topics-summary] b').first().innerText());
    assert.ok(total >= found.length, `${total} topics, ${found.length} are written`);
    // its newest sample, from the collector's own mouth
    await until('its newest sample', async () => numberIn((/committed\s+([\d,]+)/.exec(await page.locator('[data-sample]').first().innerText()) ?? [])[1] ?? '0') > 0);
  });
}

/** Makes the attempt of this page again, and compares what is drawn with what was written. */
async function isMadeAgain(page, dataset, index, attempt, button) {
  await page.getByLabel('Token').fill(token);
  await page.getByRole('button', { name: button, exact: true }).click();
  await page.waitForSelector('.view3d[data-bodies] canvas', { timeout: 150000 });
  const replay = await get(`/datasets/${dataset}/episodes/${index}/replay?attempt=${attempt}`);
  assert.equal(replay.state, 'ready');
  const kept = join(work, 'cache', 'replays', replay.id.slice('replay.'.length));
  const [plan, geometry] = ['plan.json', 'geometry.json'].map((name) => readJson(join(kept, name)));
  const pieces = (body) => geometry.geometry.some((one) => one.body === body);
  assert.equal(numberIn(await page.locator('.view3d').getAttribute('data-bodies')), geometry.bodies.filter(pieces).length);
  assert.equal(numberIn(await page.locator('.view3d').getAttribute('data-pieces')), geometry.geometry.length);
  assert.equal(await page.locator('[data-other-replay]').count(), 0, 'every object is where the episode says');
  const near = plan.nearest.at(-1);
  await page.locator('input[type=range]').evaluate((element) => { element.value = element.max; element.dispatchEvent(new Event('input', { bubbles: true })); });
  const value = near.distance_m > 0 ? `${(1000 * near.distance_m).toFixed(1)} mm` : 'touching';
  await page.waitForFunction((text) => document.querySelector('[data-nearest]')?.textContent === text, `nearest ${value}: ${near.a} – ${near.b}`);
  if (near.a_m) assert.ok((await page.locator('.view3d .labels span').allTextContents()).includes(value));
  const picture = await page.locator('.view3d').screenshot();
  assert.ok(picture.length > 4000, `the 3D view is ${picture.length} bytes of PNG: nothing was drawn`);
  assert.deepEqual(await axe(page), []);
  assert.ok(!(await get('/home')).sources.some((one) => one.id.startsWith('replay')), 'a replay is in no list');
  return plan;
}

const labData = async () => (await get('/home')).sources.find((one) => one.kind === 'dataset' && one.role === 'demonstrations' && one.name === 'data').id;

test('a failed attempt is made again and seen', { timeout: 300000 }, async () => {
  const dataset = await labData();
  const { rows } = await get(`/campaigns/${dataset}/attempts?outcome=failed&limit=200`);
  // one that moved
  const row = rows.filter((one) => one.step_s > 0).sort((a, b) => b.step_s - a.step_s)[0] ?? assert.fail('no failed attempt in the lab moved');
  await open(`/episode/${dataset}/${row.index}?attempt=${row.attempt}`, async (page) => {
    const plan = await isMadeAgain(page, dataset, row.index, row.attempt, 'Make it again');
    assert.deepEqual([plan.index, plan.seed, plan.attempt], [row.index, row.seed, row.attempt]);
    assert.equal(await page.locator('[data-made-again]').innerText(), plan.outcome);
    await page.waitForSelector('canvas[data-picture]');
    assert.equal(await page.locator('[data-seed]').first().innerText(), row.seed);
    // the cache has it: at once, and without the token
    await page.context().clearCookies();
    await page.reload();
    await page.waitForSelector('.view3d[data-bodies] canvas', { timeout: 30000 });
  });
});

test('an episode is made again to see shapes, plan and distances', { timeout: 300000 }, async () => {
  const dataset = await labData();
  const episode = await get(`/datasets/${dataset}/episodes/0`);
  await open(`/episode/${dataset}/0`, async (page) => {
    const plan = await isMadeAgain(page, dataset, 0, episode.attempt, 'Make it again, with shapes and plan');
    assert.deepEqual([plan.outcome, plan.steps], [episode.outcome, episode.steps]);
  });
});

test('a policy that is served answers about a recorded picture', { timeout: 200000 }, async () => {
  const newest = checkpoints(join(lab, 'run'))[0].name;
  policy = startEtude('policy', '--checkpoint', join(lab, 'run', 'checkpoints', newest), '--run', join(lab, 'run'));
  await until('a policy server', async () => (await get('/play/sessions')).policies.length > 0, 150000);
  const { sources } = await get('/home');
  const [run, data] = [sources.find((one) => one.kind === 'run'), sources.find((one) => one.kind === 'dataset' && one.role === 'demonstrations' && one.name !== 'growing')];
  await open('/', async (page) => {
    await page.waitForFunction(() => / serves it/.test(document.querySelector('[data-served-by]')?.textContent ?? ''), undefined, { timeout: 30000 });
    assert.equal(numberIn(await page.locator('[data-figure="checkpoint_step"]').innerText()), Number(checkpointHeader(join(lab, 'run')).step));
  });
  await open(`/inside?run=${run.id}&dataset=${data.id}&episode=0&module=TAR2D`, async (page) => {
    await page.waitForSelector('[data-said]', { timeout: 60000 });
    const step = numberIn(await page.locator('[data-insight-step]').getAttribute('data-insight-step'));
    assert.equal(step, Number(checkpointHeader(join(lab, 'run')).step));
    const names = Object.keys(JSON.parse(checkpointHeader(join(lab, 'run')).modules));
    assert.deepEqual((await page.locator('[data-said] tr[data-module]').evaluateAll((all) => all.map((one) => one.dataset.module))).sort(), names.sort());
    assert.ok(await shades(page, 'TAR2D') > 2, 'the spotlight is even');
    await looksThroughOneHead(page);
    await saysWhatWordsAndJointsAreWorth(page);
    await showsWhatIsSaidAgainstTheTruth(page);
    await changesAWord(page);
    await hidesAPartByKeyboard(page);
    await thinksOfAnotherSentence(page);
    await replacesAnOutput(page);
    assert.deepEqual(await axe(page), []);
  });
  await open(`/inside?run=${run.id}&dataset=${data.id}&episode=0&module=TAR2D&hide=90,60,20,20`, async (page) => {
    await page.waitForSelector('[data-said]', { timeout: 60000 });
    assert.equal(await page.locator('[data-hidden]').getAttribute('data-hidden'), '1', 'the mask of a deep link');
    assert.deepEqual(await axe(page), []);
    assert.deepEqual(await overflow(page), []);
  }, { width: 360, theme: 'dark' });
});

/** The bars add up to all of the attention, of a head as of all; another head has another spotlight. */
async function looksThroughOneHead(page) {
  const bars = () => page.locator('[data-attends=TAR2D] .hbar').evaluateAll((all) => all.map((one) => [one.children[0].textContent, parseInt(one.children[2].textContent, 10)]));
  const light = () => page.locator('canvas[data-attention=TAR2D]').evaluate((one) => one.getContext('2d').getImageData(0, 0, one.width, one.height).data.join());
  const whole = ([all, mean]) => { assert.equal(all[0][0], 'picture'); assert.ok(Math.abs(all.reduce((sum, [, share]) => sum + share, 0) - 100) <= all.length + 1, `${mean}: ${all}`); };
  whole([await bars(), 'mean']);
  assert.ok((await bars()).some(([name]) => name === 'words'), 'TAR2D reads the sentence');
  const mean = await light();
  await page.getByLabel('attention of').selectOption({ label: 'head 1' });
  await page.waitForURL('**head=1**');
  await until('the spotlight of one head', async () => (await light()) !== mean, 20000);
  whole([await bars(), 'head 1']);
}

/** What the gateway answers to the question that follows from an act. */
async function answerTo(page, act, is) {
  const asked = page.waitForResponse((answer) => answer.url().endsWith('/insight') && is(answer.request().postDataJSON()), { timeout: 60000 });
  await act();
  const answer = await asked;
  assert.equal(answer.status(), 200);
  const json = await answer.json();
  await page.waitForFunction(() => !document.querySelector('.stale'));
  return json;
}

const cell = (page, module, name) => page.locator(`[data-said] tr[data-module="${module}"] [data-${name}]`).innerText();
const cmIn = (text) => { const found = /([\d.e-]+) cm/.exec(text); assert.ok(found, `"${text}" has no cm`); return Number(found[1]); };
const near = (shown, wanted, what) => assert.ok(Math.abs(shown - wanted) <= 0.06 * Math.abs(wanted) + 1e-3, `${what}: ${shown}, not ${wanted}`);
const norm = (a, b) => Math.hypot(...a.map((part, i) => part - b[i]));

/** Errors are against the record's own labels; waypoints stand in space and in their table; joints are listed. */
async function showsWhatIsSaidAgainstTheTruth(page) {
  const { modules, truth, waypoints, joints } = await answerTo(page, () => page.reload(), () => true);
  const far = norm(modules.TAR3D.value, truth.positions[truth.target]);
  near(truth.errors.TAR3D.error, far, 'error of TAR3D in the answer');
  near(cmIn(await cell(page, 'TAR3D', 'error')), 100 * far, 'error of TAR3D on the page');
  near(cmIn((await page.locator('[data-node=TAR3D] [data-box-says]').textContent()).replace(/.*, |\)/g, '')), 100 * modules.TAR3D.value[2], 'height in the box of TAR3D');
  // a record ends before the last waypoints of its last pictures
  const ahead = truth.waypoints.length;
  const mean = waypoints.slice(0, ahead).reduce((sum, one, k) => sum + norm(one.slice(0, 3), truth.waypoints[k].slice(0, 3)), 0) / ahead;
  near(truth.waypoints_error_m, mean, 'error of the waypoints');
  near(cmIn(await cell(page, 'CTRL', 'error')), 100 * mean, 'error of CTRL on the page');
  await page.waitForSelector('[data-plan] canvas', { timeout: 30000 });
  const planned = await page.locator('[data-waypoints] tr', { hasText: 'planned' }).locator('td').allInnerTexts();
  assert.equal(planned.length, waypoints.length);
  near(Number(planned[11].split(' ')[0]), waypoints[11][0], 'the last planned waypoint');
  assert.equal(await page.locator('[data-joint]').count(), joints.length);
}

async function changesAWord(page) {
  const other = 'push the milk carton';
  const { modules, what_if } = await answerTo(page, () => page.getByLabel('what if this had been said?').fill(other), (body) => body.what_if?.sentence === other);
  assert.equal(new URL(page.url()).searchParams.get('other'), other);
  assert.ok((await cell(page, 'LANG', 'would')).startsWith(what_if.LANG.value));
  assert.equal(await cell(page, 'LANG', 'change'), what_if.LANG.value === modules.LANG.value ? 'same' : 'another');
  await answerTo(page, () => page.getByLabel('what if this had been said?').fill(''), (body) => !body.what_if);
}

async function hidesAPartByKeyboard(page) {
  const brush = page.locator('.hide-brush');
  for (const [key, leads] of [['h', '[data-heads] select'], ['o', '[data-instead] select'], ['m', '.hide-brush']]) {
    await page.evaluate(() => document.activeElement?.blur());
    await page.keyboard.press(key);
    assert.ok(await page.evaluate((to) => document.activeElement === document.querySelector(to), leads), `the key ${key}`);
  }
  await brush.press('ArrowRight');
  const before = await page.locator('[data-brush]').getAttribute('data-brush');
  await brush.press('ArrowLeft');
  assert.notEqual(await page.locator('[data-brush]').getAttribute('data-brush'), before);
  for (let i = 0; i < 4; i++) await brush.press('Shift+ArrowRight');
  const { modules, what_if } = await answerTo(page, () => brush.press('Enter'), (body) => body.what_if?.hide?.length === 1);
  assert.notDeepEqual(what_if.TAR2D.value, modules.TAR2D.value, 'nothing follows from what is hidden');
  near(parseFloat(await cell(page, 'TAR2D', 'change')), norm(what_if.TAR2D.value, modules.TAR2D.value), 'change of TAR2D');
  assert.match(new URL(page.url()).searchParams.get('hide'), /^\d+,\d+,32,16$/);
  await answerTo(page, () => page.reload(), (body) => body.what_if?.hide?.length === 1);
  const marked = page.getByLabel('what is marked');
  const away = await answerTo(page, () => marked.selectOption('look_away'), (body) => body.what_if?.look_away?.length === 1 && !body.what_if.hide);
  assert.notDeepEqual(away.what_if.TAR2D.value, away.modules.TAR2D.value, 'nothing follows from where nobody looks');
  assert.notDeepEqual(away.what_if.TAR2D.value, what_if.TAR2D.value, 'to be hidden is another thing');
  await answerTo(page, () => marked.selectOption('hide'), (body) => body.what_if?.hide?.length === 1);
  await answerTo(page, () => brush.press('Backspace'), (body) => !body.what_if);
  assert.equal(new URL(page.url()).searchParams.get('hide'), null);
}

/** The value is said instead, later modules follow, and the plan does. */
async function replacesAnOutput(page) {
  const offered = await page.getByLabel('what if a module said something else?').locator('option').allTextContents();
  assert.ok(offered.includes('DISP') && !offered.includes('EE2D'), `${offered}: nothing reads what EE2D says`);
  await answerTo(page, () => page.getByLabel('what if a module said something else?').selectOption({ label: 'TAR3D' }), (body) => body.what_if?.say?.TAR3D);
  const instead = [0.2, 0.1, 0.3];
  const is = (body) => body.what_if?.say?.TAR3D?.position?.[2] === instead[2];
  const field = page.getByLabel('what TAR3D.position says instead');
  const { modules, what_if, waypoints, what_if_waypoints } = await answerTo(page, () => field.fill(JSON.stringify(instead)), is);
  assert.ok(norm(what_if.TAR3D.value, instead) < 1e-4);
  near(cmIn(await cell(page, 'DISP', 'change')), 100 * norm(what_if.DISP.value, modules.DISP.value), 'change of DISP');
  const mean = waypoints.reduce((sum, one, k) => sum + norm(one.slice(0, 3), what_if_waypoints[k].slice(0, 3)), 0) / waypoints.length;
  assert.ok(mean > 0, 'the plan does not follow');
  near(cmIn(await cell(page, 'CTRL', 'change')), 100 * mean, 'change of CTRL');
  await page.waitForSelector('[data-waypoints] th:has-text("with the what-if")', { state: 'attached' });
  await answerTo(page, () => page.reload(), is);
  assert.equal(await field.inputValue(), JSON.stringify(instead), 'the deep link has it');
}

/** Without what LANG knows, then with another sentence in its register alone: what reads it follows. */
async function thinksOfAnotherSentence(page) {
  const of = page.getByLabel('what if a module thought of another sentence?');
  const thinks = (thought) => (body) => body.what_if?.think?.LANG === thought;
  const zero = await answerTo(page, () => of.selectOption({ label: 'LANG' }), thinks('zero'));
  assert.notDeepEqual(zero.what_if.TAR2D.value, zero.modules.TAR2D.value, 'nothing follows from an empty register');
  const other = 'push the milk carton';
  const field = page.getByLabel('the sentence that LANG thinks of, or zero');
  const { modules, what_if } = await answerTo(page, () => field.fill(other), thinks(other));
  near(parseFloat(await cell(page, 'TAR2D', 'change')), norm(what_if.TAR2D.value, modules.TAR2D.value), 'change of TAR2D');
  await answerTo(page, () => page.reload(), thinks(other));
  assert.equal(await field.inputValue(), other, 'the deep link has it');
  await answerTo(page, () => of.selectOption({ label: 'none' }), (body) => !body.what_if?.think);
}

/** A bar a word and a joint, as long as what the server said of it; none while nobody wants to know. */
async function saysWhatWordsAndJointsAreWorth(page) {
  const { sentence, words, joints } = await answerTo(page, () => page.reload(), () => true);
  assert.deepEqual(words.map((one) => one.word), sentence.split(/\s+/).filter(Boolean));
  assert.ok(joints.length > 6 && joints.every((one) => Number.isFinite(one.moves_m)), JSON.stringify(joints));
  assert.ok(Math.max(...words.map((one) => one.moves_m)) > 0, 'no word matters');
  await page.waitForSelector('[data-worth]', { timeout: 60000 });
  const bars = await page.locator('[data-worth] .hbar').evaluateAll((all) => all.map((one) => [one.children[0].textContent, parseFloat(one.children[2].textContent)]));
  assert.deepEqual(bars.map(([name]) => name), [...words.map((one) => one.word), ...joints.map((one) => one.name)]);
  bars.forEach(([name, cm], i) => assert.ok(Math.abs(cm - 100 * [...words, ...joints][i].moves_m) <= 0.05 * cm + 0.001, name));
  await answerTo(page, () => page.getByLabel(/what each word and joint is worth/).uncheck(), (body) => !body.what_if);
  await page.waitForURL('**worth=off**');
  await until('the bars to go', async () => (await page.locator('[data-worth]').count()) === 0, 20000);
}

/** How many different shades a spotlight has, as soon as it has more than one. */
async function shades(page, module) {
  const canvas = `canvas[data-attention${module ? `="${module}"` : ''}]`;
  const handle = await page.waitForFunction((selector) => {
    const element = document.querySelector(selector);
    if (!element) return 0;
    const { data } = element.getContext('2d').getImageData(0, 0, element.width, element.height);
    const different = new Set(data.filter((_value, i) => i % 4 === 3)).size;
    return different > 1 ? different : 0;
  }, canvas, { timeout: 60000 });
  return handle.jsonValue();
}

const state = (session) => get(`/play/sessions/${session}`);

/** Opens a session by the page's own form; its name, and an object that a sentence can be about. */
async function openSession(page) {
  await page.waitForFunction(() => [...document.querySelectorAll('select')].some((one) => [...one.options].some((option) => /@[0-9a-f]{16}$/.test(option.value))), undefined, { timeout: 30000 });
  await page.getByLabel('Token').fill(token);
  await page.getByRole('button', { name: 'Open', exact: true }).click();
  await page.waitForURL('**session=play-**');
  await page.waitForSelector('.play-picture img', { timeout: 120000 });
  const session = new URL(page.url()).searchParams.get('session');
  const { objects } = (await state(session)).scene;
  return { session, object: ['coke', 'pepsi', 'milk', 'bread', 'bottle', 'cube'].find((name) => objects.some((one) => one.name === name)) };
}

async function typesASentence(page, object) {
  await page.getByLabel('Sentence').fill(`push the xylophonic ${object}`);
  await page.waitForSelector('[data-words]');
  assert.ok(checkpointHeader(join(lab, 'run')).words.split(' ').includes('push'));
  assert.equal(await page.locator('[data-words]').getAttribute('data-words'), 'training');
  assert.match(await page.locator('[data-unseen]').innerText(), /never said: xylophonic$/);
  assert.match(await page.locator('[data-meaning]').innerText(), new RegExp(`^means push ${object}`));
}

/** A sentence that means nothing to the parser is judged by what one chooses; the address has it. */
async function choosesWhatItIsJudgedBy(page, object) {
  await page.getByLabel('Sentence').fill('xylophone');
  await page.waitForSelector('[data-meaning] .warn');
  await page.getByRole('combobox', { name: 'Judged by', exact: true }).selectOption('push');
  await page.getByLabel('Object that it is judged by').selectOption(object);
  assert.equal(new URL(page.url()).searchParams.get('judge'), `push,${object}`);
}

/** Pictures come, and what the policy attends to and plans lies over them. */
async function followsThePolicy(page, session) {
  assert.ok(await shades(page) > 2, 'the spotlight is even');
  const looked = await get(`/play/sessions/${session}/insight`);
  const [module, columns, rows] = await page.locator('canvas[data-attention]').evaluate((one) => [one.dataset.attention, one.width, one.height]);
  assert.deepEqual([columns, rows], [looked.attention[module].columns, looked.attention[module].rows]);
  assert.equal(looked.modules[module].entity, 'target', 'by itself it shows where the target is looked for');
  await page.waitForFunction(() => (document.querySelector('.play-picture polyline')?.getAttribute('points') ?? '').split(' ').length > 3, undefined, { timeout: 30000 });
  const frame = () => page.locator('.play-picture img').getAttribute('data-frame').then(Number);
  const before = await frame();
  await until('three more pictures', async () => (await frame()) > before + 2, 30000);
  for (const theme of process.env.ETUDE_SHOTS ? themes : []) {
    await page.emulateMedia({ colorScheme: theme });
    await page.screenshot({ path: join(process.env.ETUDE_SHOTS, `play-session-1280-${theme}.png`), fullPage: true });
  }
}

/** The judge's word on the page is the worker's. */
async function isJudged(page, session) {
  await page.waitForFunction(() => !/under way/.test(document.querySelector('.verdict .chip')?.textContent ?? 'under way'), undefined, { timeout: 200000 });
  const done = await state(session);
  assert.ok(done.outcome && !['refused', 'policy_error'].includes(done.outcome), `${done.outcome}: ${done.reason}`);
  assert.match(await page.locator('.verdict .chip').first().innerText(), new RegExp(`${done.outcome}$`));
  assert.equal(await page.locator('.verdict header .num').innerText(), `${done.successes} of ${done.attempts} done`);
  assert.equal(done.attempts, 1);
}

/** The same scene again, and an object in it moved by keyboard. */
async function movesAnObject(page, session, object) {
  await page.getByRole('button', { name: 'Reset' }).click();
  await until('the verdict to be gone', async () => (await page.locator('.verdict').count()) === 0);
  const x = async () => (await state(session)).scene.objects.find((one) => one.name === object).x;
  const refused = async () => (await page.locator('.play [role=alert]').count()) > 0;
  const stood = await x();
  const others = async () => (await state(session)).scene.objects.filter((one) => one.name !== object).map((one) => [one.name, one.x, one.y, one.hidden]);
  const [hidden] = (await state(session)).scene.objects.map((one) => one.name).filter((name) => name !== object);
  await page.locator(`[data-object="${hidden}"]`).press('Enter');
  await page.getByRole('button', { name: 'Hide' }).click();
  await until(`${hidden} to be hidden`, async () => (await others()).some((one) => one[3]));
  const before = await others();
  await page.locator(`[data-object="${object}"]`).press('ArrowRight');
  await until(`${object} to stand 1 cm further`, async () => (await refused()) || Math.abs((await x()) - (stood - 0.01)) < 0.004, 30000);
  assert.ok(!(await refused()), 'it was refused');
  // they breathe by parts of a millimetre
  const near = (a, b) => a.every((value, k) => (typeof value === 'number' ? Math.abs(value - b[k]) < 0.002 : value === b[k]));
  const after = await others();
  assert.ok(after.every((one, i) => near(one, before[i])), `all others are as they were: ${JSON.stringify({ before, after })}`);
}

test('Play: a sentence is typed, the policy drives, the judge has the last word', { timeout: 400000 }, async () => {
  const { page, context, wrong } = await openPage(browser, gateway.address);
  try {
    await visit(page, `${gateway.address}/play`);
    const { session, object } = await openSession(page);
    await typesASentence(page, object);
    await choosesWhatItIsJudgedBy(page, object);
    for (const width of [360, 1280]) {
      for (const theme of themes) {
        await open(`/play?session=${session}`, async (other) => {
          await other.waitForSelector('.play-picture img');
          assert.deepEqual(await axe(other), [], `${width} ${theme}`);
          assert.deepEqual(await overflow(other), [], `${width} ${theme}`);
        }, { width, theme });
      }
    }
    // by the key: no field has the focus
    const said = page.waitForRequest((one) => one.url().endsWith('/commands') && one.postDataJSON().action === 'say');
    await page.evaluate(() => document.activeElement?.blur());
    await page.keyboard.press('r');
    assert.deepEqual((await said).postDataJSON().arguments, { sentence: 'xylophone', task: 'push', target: object, reference: '' });
    await followsThePolicy(page, session);
    await isJudged(page, session);
    await movesAnObject(page, session, object);
    assert.deepEqual(wrong, []);
    await page.getByRole('button', { name: 'Close', exact: true }).click();
    await page.waitForSelector(`[data-ended="${session}"]`, { timeout: 30000 });
    assert.equal(await page.getByRole('button', { name: 'Open the same scene again' }).isEnabled(), true);
    assert.equal(new URL(page.url()).searchParams.get('sentence'), 'xylophone');
    await open('/play?session=play-gone&index=3&seed=18446744073709551615', async (other) => {
      await other.waitForSelector('[data-ended="play-gone"]', { timeout: 40000 });
      assert.equal(await other.getByLabel('Number').inputValue(), '3');
      assert.equal(await other.getByLabel('Seed').inputValue(), '18446744073709551615');
      await other.waitForFunction(() => /worker play .*--index 3 --seed 18446744073709551615/.test(document.querySelector('.command code')?.textContent ?? ''), undefined, { timeout: 10000 });
    });
  } finally {
    await context.close();
  }
});
