// SPDX-License-Identifier: Apache-2.0
// Pages in states that no folder of a test has: many sources that are live at once, answers that fail, a browser without a
// clipboard. The gateway and its pages are real; what it answers is put in its place here.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync } from 'node:fs';
import { after, before, test } from 'node:test';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { axe, launch, openPage } from './browser.mjs';
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
 * Opens `address`; `answers` by path of the API give a body, { status, json }, or a function of the request's URL that
 * gives either. What they do not name the gateway answers. `push(ch, data)` says something on a live channel.
 */
async function open(address, answers, look, { allow = /^$/ } = {}) {
  const { page, context, wrong } = await openPage(browser, gateway.address);
  const subscribed = new Map();
  await page.routeWebSocket(/\/api\/v1\/live/, (socket) => {
    socket.onMessage((text) => {
      const { op, ch, id } = JSON.parse(text);
      if (op === 'sub') subscribed.set(ch, { socket, id });
    });
  });
  await page.route('**/api/v1/**', async (route) => {
    const url = new URL(route.request().url());
    let answer = answers[url.pathname.slice('/api/v1'.length)];
    if (typeof answer === 'function') answer = answer(url);
    if (answer === undefined) return route.continue();
    return Buffer.isBuffer(answer) ? route.fulfill({ body: answer, contentType: 'application/octet-stream' })
      : answer.status ? route.fulfill(answer) : route.fulfill({ json: answer });
  });
  const push = async (ch, data) => {
    for (const end = Date.now() + 10000; !subscribed.has(ch);) {
      assert.ok(Date.now() < end, `nobody has subscribed to ${ch}`);
      await new Promise((done) => setTimeout(done, 20));
    }
    const { socket, id } = subscribed.get(ch);
    socket.send(JSON.stringify({ ch, id, seq: 1, t: '', data }));
  };
  try {
    await page.goto(gateway.address + address);
    await page.waitForSelector('main h1', { state: 'attached' });
    await look(page, push);
    assert.deepEqual(wrong.filter((one) => !allow.test(one)), []);
  } finally {
    await context.close();
  }
}

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
      await push('fleet', fleetOf(['lab-a', 'lab-b'], { per_min: i }));
      await page.waitForSelector(`[data-fleet-summary]:has-text("${i} a minute")`);
    }
    assert.equal(await field.inputValue(), 'lab-b w1');
    await page.waitForURL('**filter=lab-b+w1**');
    assert.equal(await field.inputValue(), 'lab-b w1');
    assert.ok(asked.includes('lab-b w1'));
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
