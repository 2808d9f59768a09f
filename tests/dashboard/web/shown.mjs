// SPDX-License-Identifier: Apache-2.0
// The figures of each page as it shows them, and all pages open at once while their gateway comes and goes.
import assert from 'node:assert/strict';
import { openPage, settle, visit } from './browser.mjs';

const numbers = (texts) => texts.map((one) => Number(one.replaceAll(',', '')));
const texts = async (page, selector) => (await page.locator(selector).allTextContents()).map((one) => one.trim());

/** By name of the page (addresses() of browser.mjs): its figures, in an order that is always the same. */
const figures = {
  overview: async (page) => numbers((await Promise.all(['committed', 'step', 'checkpoint_step'].map((name) => texts(page, `[data-figure="${name}"]`)))).flat()),
  // workers; the row of a host can be folded
  fleet: async (page) => (await page.locator('[role=row][data-id]:has([data-failures]):not(:has([aria-expanded]))').evaluateAll((all) => all.map((row) => [row.dataset.id, Number(row.querySelector('[data-column="episodes"]').textContent.replaceAll(',', ''))]))).sort(),
  generation: async (page) => [...numbers(await texts(page, '[data-attempts-summary] b')).slice(0, 3), numbers(await texts(page, '[data-matrix] tbody td.strong')).reduce((sum, one) => sum + one, 0)],
  dataset: async (page) => [...numbers(await texts(page, '[data-dataset-summary] b')).slice(0, 1), ...(await texts(page, '[data-task-target] td'))],
  episode: (page) => texts(page, '[data-episode-index], [data-seed], [data-instruction]'),
  attempt: (page) => texts(page, '.page-head .figure, [data-reason], [data-seed]'),
  training: async (page) => [...numbers(await texts(page, '[data-run-summary] b')).slice(0, 1), ...numbers(await texts(page, 'table[data-table="Loss"] tr[data-line=train] td'))],
  inside: (page) => texts(page, '[data-node]'),
  checkpoints: async (page) => [...(await page.locator('[role=row][data-id]').evaluateAll((all) => all.map((row) => row.dataset.id))), ...(await texts(page, '[data-sha256]'))],
  evaluation: async (page) => [...numbers(await texts(page, '[data-figure="successes"]')), await page.locator('[data-scene]').count()],
  compare: (page) => texts(page, '[data-pair] table td'),
  kept: (page) => texts(page, '[data-decision], [data-said] td'),
  rollout: (page) => texts(page, '[data-episode-index], [data-seed], [data-instruction]'),
  play: (page) => texts(page, 'main option, main .command code'),
  topics: (page) => texts(page, 'main .empty, main [role=row][data-id] [data-column="topic"]'),
  logs: (page) => texts(page, '.log-box .log li:last-child > span:last-child'),
};

export function shown(name, page) {
  return (figures[name] ?? assert.fail(`nobody has said what the page ${name} shows`))(page);
}

/** Waits until the page shows this; says what it shows instead. A number may be short of its last digits. */
export async function shows(name, page, wanted, limit = 60000) {
  const rounded = (value) => JSON.stringify(value, (_key, one) => (typeof one === 'number' ? Number(one.toPrecision(9)) : one));
  const end = Date.now() + limit;
  for (;;) {
    const now = await shown(name, page);
    if (rounded(now) === rounded(wanted)) return;
    if (Date.now() > end) assert.deepEqual(now, wanted, `${name}, after ${limit / 1000} s`);
    await new Promise((done) => setTimeout(done, 100));
  }
}

/** Every address in a window of its own. `answers` counts what the gateway answered to a page. */
export async function openAll(browser, gateway, pages) {
  const opened = [];
  for (const [name, address] of Object.entries(pages)) {
    const one = { name, answers: 0, ...(await openPage(browser, gateway.address)) };
    one.page.on('response', (answer) => { if (answer.url().includes('/api/v1/') && answer.status() === 200) one.answers++; });
    await visit(one.page, gateway.address + address);
    // what comes after the first answer: rollouts, pairs, curves
    await one.page.waitForLoadState('networkidle').catch(() => undefined);
    await one.page.waitForSelector('.connection[data-state=live]');
    if (name === 'checkpoints') await one.page.waitForFunction(() => document.querySelector('[data-sha256]')?.textContent !== 'computing', undefined, { timeout: 30000 });
    // gone with the document, were it loaded again
    await one.page.evaluate(() => { globalThis.openedOnce = true; });
    opened.push(one);
  }
  return opened;
}

export async function closeAll(opened) {
  for (const { context } of opened) await context.close();
}

/** Kills the gateway under open pages: each says so, and finds the one that `start` gives by itself, without being loaded again. */
export async function restart(gateway, opened, start) {
  await gateway.stop('SIGKILL');
  for (const { name, page } of opened) await page.waitForSelector('.banner', { timeout: 15000 }).catch((error) => assert.fail(`${name}: ${error.message}`));
  for (const one of opened) one.answers = 0;
  const started = await start(Number(new URL(gateway.address).port));
  for (const { name, page } of opened) await page.waitForSelector('.banner', { state: 'detached', timeout: 20000 }).catch((error) => assert.fail(`${name}: ${error.message}`));
  return started;
}

/** What holds of every page once its gateway is back. */
export async function cameBack(opened) {
  for (const one of opened) {
    await settle(one.page);
    // the run of the lab is over: nobody answers for it
    assert.equal(await one.page.locator('.problem', { hasNotText: 'Nobody serves it' }).count(), 0, `${one.name} shows a problem`);
    assert.ok(await one.page.evaluate(() => globalThis.openedOnce === true), `${one.name} was loaded again`);
    for (const end = Date.now() + 20000; one.answers === 0;) {
      assert.ok(Date.now() < end, `${one.name} has not asked again: what it shows is old`);
      await new Promise((done) => setTimeout(done, 100));
    }
    assert.deepEqual(one.wrong.filter((line) => /^(exception|foreign)|could not be drawn/.test(line)), [], one.name);
  }
}
