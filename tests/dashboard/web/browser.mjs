// SPDX-License-Identifier: Apache-2.0
// Debian's Chromium by playwright-core, and what every test asks of every page: no errors, no foreign requests.
import assert from 'node:assert/strict';
import { createRequire } from 'node:module';
import { existsSync, readFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';

const here = dirname(fileURLToPath(import.meta.url));
const require = createRequire(join(here, '../../../dashboard/web/package.json'));
const { chromium } = require('playwright-core');
const axeSource = readFileSync(require.resolve('axe-core/axe.min.js'), 'utf8');

export const widths = [360, 1280, 2560];
export const themes = ['light', 'dark'];

export async function launch() {
  const executablePath = ['/usr/bin/chromium', '/usr/bin/chromium-browser'].find(existsSync);
  if (!executablePath) throw new Error('chromium is not installed: run deploy/install --browser');
  // WebGL in software needs its flag; a container has no user namespaces for the sandbox
  return chromium.launch({ executablePath, args: ['--no-sandbox', '--enable-unsafe-swiftshader', '--disable-dev-shm-usage'] });
}

/** A page that notes what must not happen: console errors, exceptions, requests to another origin. */
export async function openPage(browser, base, { width = 1280, height = 900, theme = 'light' } = {}) {
  const context = await browser.newContext({ viewport: { width, height }, colorScheme: theme, reducedMotion: 'reduce', deviceScaleFactor: 1 });
  const page = await context.newPage();
  const wrong = [];
  // that scenes differ (409) is an answer, which the browser notes as a failed request
  page.on('console', (message) => { if (message.type() === 'error' && !message.text().includes('409 (Conflict)')) wrong.push(`console: ${message.text()} ${message.location().url ?? ''}`); });
  page.on('pageerror', (error) => wrong.push(`exception: ${error.message}`));
  page.on('request', (request) => { if (!/^(data|blob):/.test(request.url()) && new URL(request.url()).host !== new URL(base).host) wrong.push(`foreign request: ${request.url()}`); });
  return { page, context, wrong };
}

/** Goes there and waits until nothing is loading any more. */
export async function visit(page, address) {
  await page.goto(address, { waitUntil: 'domcontentloaded' });
  await settle(page);
}

export async function settle(page) {
  await page.waitForSelector('main h1', { state: 'attached', timeout: 10000 });
  await page.waitForFunction(() => !document.querySelector('.skeleton, .stale, [data-loading]') && document.querySelector('main').childElementCount > 1, undefined, { timeout: 20000 });
  // charts are drawn in the next frames
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  await drawn(page);
}

/** Nothing stands where a page would, but could not be drawn. */
async function drawn(page) {
  assert.deepEqual(await page.locator('[data-broken]').allInnerTexts(), []);
}

/** Violations of axe, one line each. */
export async function axe(page) {
  await page.evaluate(axeSource);
  const found = await page.evaluate(() => globalThis.axe.run(document, { resultTypes: ['violations'] }));
  return found.violations.map((one) => `${one.id}: ${one.help}: ${one.nodes.slice(0, 3).map((node) => `${node.target.join(' ')} ${node.failureSummary?.split('\n')[1]?.trim() ?? ''}`).join(' | ')}`);
}

/** What is wider than the window, which would scroll the page sideways. */
export async function overflow(page) {
  return page.evaluate(() => (document.documentElement.scrollWidth > document.documentElement.clientWidth
    ? [...document.querySelectorAll('main *')].filter((one) => one.getBoundingClientRect().right > document.documentElement.clientWidth + 1 && !one.closest('.table, .scroll-x, .graph, .command')).slice(0, 3).map((one) => `${one.tagName}.${one.className}`)
    : []));
}

/** Addresses of every page of a gateway over its sources. */
export async function addresses(base) {
  const get = async (path) => (await fetch(`${base}/api/v1${path}`)).json();
  const home = await get('/home');
  const of = (kind, role) => home.sources.find((one) => one.kind === kind && (!role || one.role === role))?.id;
  const [run, data, evaluation, rollouts] = [of('run'), of('dataset', 'demonstrations'), of('eval'), of('dataset', 'rollouts')];
  const failed = data ? (await get(`/campaigns/${data}/attempts?outcome=failed&limit=1`)).rows[0] : undefined;
  const others = home.sources.filter((one) => one.kind === 'eval' && one.id !== evaluation);
  const kept = evaluation && (await get(`/evals/${evaluation}`)).insights > 0;
  return {
    overview: '/',
    fleet: '/fleet',
    ...(data ? { generation: `/generation?dataset=${data}`, dataset: `/dataset?dataset=${data}`, episode: `/episode/${data}/0` } : {}),
    ...(failed ? { attempt: `/episode/${data}/${failed.index}?attempt=${failed.attempt}` } : {}),
    ...(run ? { training: `/training?run=${run}`, inside: `/inside?run=${run}`, checkpoints: `/checkpoints?run=${run}` } : {}),
    ...(evaluation ? { evaluation: `/evaluation?eval=${evaluation}` } : {}),
    ...(kept ? { kept: `/inside?eval=${evaluation}` } : {}),
    ...(others.length ? { compare: `/evaluation?eval=${evaluation}&vs=${others[0].id}` } : {}),
    ...(rollouts ? { rollout: `/episode/${rollouts}/0` } : {}),
    play: '/play',
    topics: '/topics',
    logs: '/logs',
  };
}

/** Opens an address of a gateway, gives the page to `look`, and asks that nothing went wrong meanwhile. */
export async function lookAt(browser, gateway, address, look, options = {}) {
  const { page, context, wrong } = await openPage(browser, gateway.address, options);
  try {
    await visit(page, gateway.address + address);
    await look(page);
    await drawn(page);
    assert.deepEqual(wrong, []);
  } finally {
    await context.close();
  }
}
