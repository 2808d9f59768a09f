// SPDX-License-Identifier: Apache-2.0
// The pages over what goes on now, in Debian's Chromium: demonstrations that are committed while a page is open, a policy
// that is asked about a recorded picture, and a play session from the first word to the judge's.
// ETUDE_LAB: what make_lab.mjs made. ETUDE_DOMAIN: a DDS domain of its own. ETUDE_SHOTS: a folder for pictures of Play.
import assert from 'node:assert/strict';
import { mkdirSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { after, before, test } from 'node:test';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { axe, launch, lookAt, openPage, overflow, themes, visit } from './browser.mjs';
import { checkpointHeader, checkpoints, episodeFiles } from './files.mjs';
import { startGateway } from './gateway.mjs';
import { onDomain, startEtude } from './programs.mjs';

const lab = resolve(process.env.ETUDE_LAB ?? '.');
const work = mkdtempSync(join(tmpdir(), 'etude-live-'));
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
    await open(`/dataset?dataset=${dataset.id}`, async (page) => {
      const shown = async () => numberIn(await page.locator('[data-dataset-summary] b').first().innerText());
      const first = await shown();
      assert.ok(first > 0);
      await until('the page to count more', async () => (await shown()) > first);
      await page.waitForSelector('.pill');
      await collector.stop('SIGINT');
      const files = episodeFiles(growing).length;
      await until(`the page to count ${files}`, async () => (await shown()) === files);
      await page.locator('.pill').click();
      await until(`${files} rows`, async () => numberIn((await page.locator('[data-total]').innerText()).split(' ')[0]) === files);
    });
  } finally {
    await collector.stop('SIGINT');
  }
});

test('a policy that is served answers about a recorded picture', { timeout: 200000 }, async () => {
  const newest = checkpoints(join(lab, 'run'))[0].name;
  policy = startEtude('policy', '--checkpoint', join(lab, 'run', 'checkpoints', newest), '--run', join(lab, 'run'));
  await until('a policy server', async () => (await get('/play/sessions')).policies.length > 0, 150000);
  const { sources } = await get('/home');
  const [run, data] = [sources.find((one) => one.kind === 'run'), sources.find((one) => one.kind === 'dataset' && one.role === 'demonstrations' && one.name !== 'growing')];
  await open(`/inside?run=${run.id}&dataset=${data.id}&episode=0&module=TAR2D`, async (page) => {
    await page.waitForSelector('[data-said]', { timeout: 60000 });
    const step = numberIn(await page.locator('[data-insight-step]').getAttribute('data-insight-step'));
    assert.equal(step, Number(checkpointHeader(join(lab, 'run')).step));
    const names = Object.keys(JSON.parse(checkpointHeader(join(lab, 'run')).modules));
    assert.deepEqual((await page.locator('[data-said] tr[data-module]').evaluateAll((all) => all.map((one) => one.dataset.module))).sort(), names.sort());
    assert.ok(await shades(page, 'TAR2D') > 2, 'the spotlight is even');
  });
});

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
  await page.locator(`[data-object="${object}"]`).press('ArrowRight');
  await until(`${object} to stand 1 cm further`, async () => (await refused()) || Math.abs((await x()) - (stood - 0.01)) < 0.004, 30000);
  assert.ok(!(await refused()), 'it was refused');
}

test('Play: a sentence is typed, the policy drives, the judge has the last word', { timeout: 400000 }, async () => {
  const { page, context, wrong } = await openPage(browser, gateway.address);
  try {
    await visit(page, `${gateway.address}/play`);
    const { session, object } = await openSession(page);
    await typesASentence(page, object);
    for (const width of [360, 1280]) {
      for (const theme of themes) {
        await open(`/play?session=${session}`, async (other) => {
          await other.waitForSelector('.play-picture img');
          assert.deepEqual(await axe(other), [], `${width} ${theme}`);
          assert.deepEqual(await overflow(other), [], `${width} ${theme}`);
        }, { width, theme });
      }
    }
    await page.getByLabel('Sentence').press('Enter');
    await followsThePolicy(page, session);
    await isJudged(page, session);
    await movesAnObject(page, session, object);
    assert.deepEqual(wrong, []);
    await page.getByRole('button', { name: 'Close', exact: true }).click();
    await page.waitForSelector('text=is being opened, or has ended', { timeout: 30000 });
  } finally {
    await context.close();
  }
});
