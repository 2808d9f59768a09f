// SPDX-License-Identifier: Apache-2.0
// Every page of the real gateway over real folders, in Debian's Chromium: figures against the files, axe, keyboard, a restart.
// ETUDE_DIRS: the folders, separated by ':'.
import assert from 'node:assert/strict';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { after, before, test } from 'node:test';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { addresses, axe, launch, lookAt, openPage, overflow, settle, themes, visit, widths } from './browser.mjs';
import { checkpointHeader, checkpoints, episodeFiles, foldersWith, insights, linesOf, readJson, readLines, series } from './files.mjs';
import { startGateway } from './gateway.mjs';
import { makeMany } from './many.mjs';
import { onDomain } from './programs.mjs';
import { cameBack, closeAll, openAll, restart, shown, shows } from './shown.mjs';

const dirs = (process.env.ETUDE_DIRS ?? '').split(':').filter(Boolean).map((one) => resolve(one));
let gateway;
let browser;
let home;
let pages;

before(async () => {
  assert.ok(dirs.length, 'ETUDE_DIRS names no folder');
  gateway = await startGateway(dirs, 0, onDomain);
  browser = await launch();
  home = await get('/home');
  pages = await addresses(gateway.address);
  if (!process.env.ETUDE_LAB) return;
  // of the lab everything is there: a test that returns early would have looked at nothing
  for (const page of ['episode', 'attempt', 'training', 'inside', 'checkpoints', 'evaluation', 'kept', 'compare', 'rollout']) assert.ok(pages[page], `the gateway has no page ${page} of the lab`);
  assert.ok(!(await get('/fleet')).live, `somebody else is on the bus: ${onDomain.join(' ')}`);
});

after(async () => {
  await browser?.close();
  await gateway?.stop();
});

const get = async (path) => (await fetch(`${gateway.address}/api/v1${path}`)).json();

const open = (address, look, options) => lookAt(browser, gateway, address, look, options);

/** The folder on disk of a source, which the gateway names from the folder given or from that one's parent. */
function folderOf(source, file) {
  const all = foldersWith(dirs, file);
  const found = all.find((folder) => dirs.some((dir) => resolve(dir, source.folder ?? '.') === folder)) ?? all.find((folder) => folder.endsWith(`/${source.folder}`));
  return found ?? assert.fail(`none of ${all.join(', ')} is ${source.name} (${source.folder})`);
}

const source = (kind, role) => home.sources.find((one) => one.kind === kind && (!role || one.role === role));
const text = async (page, selector) => (await page.locator(selector).first().innerText()).trim();
const number = (shown) => Number(shown.replaceAll(',', ''));
const close = (a, b, what) => assert.ok(Math.abs(a - b) <= 1e-9 * Math.max(1, Math.abs(b)), `${what}: page ${a}, file ${b}`);

test('the browser plays H.264 and draws WebGL', async () => {
  await open('/', async (page) => {
    const able = await page.evaluate(() => ({ h264: document.createElement('video').canPlayType('video/mp4; codecs="avc1.42E01E"'), webgl: Boolean(document.createElement('canvas').getContext('webgl2')) }));
    assert.notEqual(able.h264, '');
    assert.ok(able.webgl);
  });
});

test('a gateway for other machines is signed in to, and shows everything then', async () => {
  const folder = mkdtempSync(join(tmpdir(), `etude-test-${process.pid}-`));
  const file = join(folder, 'token');
  writeFileSync(file, 'a token of some length\n', { mode: 0o600 });
  const open_to_all = await startGateway(dirs, 0, ['--no-bus', '--bind', '0.0.0.0', '--token-file', file]);
  const { page, context } = await openPage(browser, open_to_all.address);
  try {
    await page.goto(`${open_to_all.address}/training`);
    await page.waitForSelector('[data-sign-in]');
    assert.equal(await page.locator('.banner').count(), 0, 'it does answer');
    assert.deepEqual(await axe(page), []);
    const enter = async (token) => {
      await page.getByLabel('Token').fill(token);
      await page.getByRole('button', { name: 'Sign in' }).click();
    };
    await enter('another token');
    await page.waitForSelector('.problem');
    await enter('a token of some length');
    await page.waitForSelector('.connection[data-state=live]');
    assert.equal(await page.locator('[data-sign-in], .banner').count(), 0);
    await page.waitForFunction(() => document.querySelector('[data-sentence]')?.textContent);
  } finally {
    await context.close();
    await open_to_all.stop();
    rmSync(folder, { recursive: true });
  }
});

test('every page opens without errors, fits its window and passes axe', async (t) => {
  for (const [name, address] of Object.entries(pages)) {
    for (const width of widths) {
      for (const theme of themes) {
        await t.test(`${name} ${width} ${theme}`, async () => {
          await open(address, async (page) => {
            assert.deepEqual(await axe(page), []);
            assert.deepEqual(await overflow(page), []);
          }, { width, theme });
        });
      }
    }
  }
});

test('Overview says what the gateway says, intervals as in eval.json', async () => {
  await open('/', async (page) => {
    assert.equal(await text(page, '[data-overview-sentence]'), (await get('/home')).sentence);
    const success = home.tiles.success;
    if (success?.kind !== 'eval') return;
    const file = readJson(join(folderOf(home.sources.find((one) => one.id === success.source), 'eval.json'), 'eval.json'));
    for (const task of file.per_task) {
      const row = await text(page, `.dot-row:has-text("${task.task}")`);
      assert.ok(row.includes(`[${(100 * task.success.low).toFixed(1)} ${(100 * task.success.high).toFixed(1)}]`), row);
    }
  });
});

test('Overview counts what the folders hold: demonstrations, steps, stages', async () => {
  const of = (kind, id) => home.sources.find((one) => one.kind === kind && one.id === id && one.folder);
  const data = of('dataset', home.tiles.demonstrations?.source);
  const run = of('run', home.tiles.training?.source);
  await open('/', async (page) => {
    const figure = async (name) => number(await text(page, `[data-figure="${name}"]`));
    if (data && !home.tiles.demonstrations.live) assert.equal(await figure('committed'), episodeFiles(folderOf(data, 'dataset.json')).length);
    if (!run || home.tiles.training.live) return;
    const folder = folderOf(run, 'metrics.jsonl');
    assert.equal(await figure('step'), readLines(join(folder, 'metrics.jsonl')).filter((one) => one.kind === 'train').at(-1).step);
    const steps = await page.locator('.ladder li').allInnerTexts();
    const advances = readLines(join(folder, 'curriculum.jsonl'));
    advances.forEach((one, i) => assert.ok(steps[i].includes(`to ${one.step.toLocaleString('en-US')}`), `${steps[i]}, ${JSON.stringify(one)}`));
  });
});

test('Training: every curve has the least, largest and last value of metrics.jsonl', async () => {
  const run = source('run');
  if (!run) return;
  const folder = folderOf(run, 'metrics.jsonl');
  const about = await get(`/runs/${run.id}`);
  if (about.state === 'running') return;
  await open(pages.training, async (page) => {
    const tables = await page.evaluate(() => Object.fromEntries([...document.querySelectorAll('table[data-table]')].map((table) => [table.dataset.table, Object.fromEntries([...table.querySelectorAll('tr[data-line]')].map((row) => [row.dataset.line, [...row.querySelectorAll('td')].map((cell) => Number(cell.textContent))]))])));
    const compare = (table, line, kind, key) => {
      const [, min, max, last] = tables[table]?.[line] ?? assert.fail(`no line ${line} in chart ${table}`);
      const file = series(folder, kind, key);
      close(min, file.min, `${key} min`);
      close(max, file.max, `${key} max`);
      close(last, file.last, `${key} last`);
    };
    compare('Loss', 'train', 'train', 'loss');
    compare('Loss', 'valid', 'valid', 'loss');
    compare('learning rate', 'train', 'train', 'learning_rate');
    const [compute, data] = ['compute', 'data'].map((line) => tables['samples per second'][line]?.[3] ?? assert.fail(`no ${line} in the samples per second`));
    close(compute + data, series(folder, 'train', 'samples_per_second').last, 'both parts of the samples per second');
    assert.equal(await page.locator('a[download]', { hasText: 'CSV' }).evaluate((one) => fetch(one.href).then((answer) => answer.text()).then((csv) => csv.split(',').slice(0, 3).join())), 'run,kind,step');
    for (const key of about.keys.filter((one) => one.kind === 'train' && one.module)) {
      const figure = key.name.slice(key.module.length + 1);
      if (figure === 'gradient') compare('gradient norm by part', key.module, 'train', key.name);
      else compare(`${key.module} loss`, figure, 'train', key.name);
    }
    const ended = readLines(join(folder, 'curriculum.jsonl'));
    const said = ended.length ? await text(page, '[data-advances]') : '';
    for (const one of ended) assert.ok(said.includes(one.reason), one.reason);
  });
});

test('Training: the CSV that is downloaded has every number of metrics.jsonl', async () => {
  const run = source('run');
  if (!run || (await get(`/runs/${run.id}`)).state === 'running') return;
  const of = (kind) => linesOf(folderOf(run, 'metrics.jsonl'), kind);
  const namesOf = (lines) => [...new Set(lines.flatMap((line) => Object.keys(line).filter((name) => typeof line[name] === 'number' || line[name] === null)))];
  const [lines, names] = [of('train'), namesOf(of('train'))];
  await open(pages.training, async (page) => {
    const download = page.waitForEvent('download');
    await page.getByRole('link', { name: 'CSV', exact: true }).click();
    const [head, ...rows] = readFileSync(await (await download).path(), 'utf8').trimEnd().split('\n').map((row) => row.split(','));
    for (const name of [...names, ...namesOf(of('valid')), 'run', 'kind']) assert.ok(head.includes(name), name);
    const trained = rows.filter((row) => row[head.indexOf('kind')] === 'train');
    assert.equal(trained.length, lines.length);
    assert.equal(rows.filter((row) => row[head.indexOf('kind')] === 'valid').length, of('valid').length);
    const number = (cell) => (cell === '' ? null : Number(cell));
    trained.forEach((row, i) => names.forEach((name) => assert.equal(number(row[head.indexOf(name)]), lines[i][name] ?? null, `${name} at step ${lines[i].step}`)));
  });
});

test('Evaluation: successes, n, failures first, seeds beyond 2^53', async () => {
  const evaluation = source('eval');
  if (!evaluation) return;
  const file = readJson(join(folderOf(evaluation, 'eval.json'), 'eval.json'));
  await open(pages.evaluation, async (page) => {
    assert.equal(number(await text(page, '[data-figure="successes"]')), file.overall.success.successes);
    assert.equal(await text(page, '[data-seed]'), file.seed);
    await page.waitForFunction((n) => document.querySelectorAll('[data-scene]').length === n, file.per_episode.length);
    const cells = await page.locator('[data-scene]').evaluateAll((all) => all.map((one) => ({ index: Number(one.dataset.scene), outcome: one.dataset.outcome })));
    assert.equal(cells.length, file.per_episode.length);
    const failed = file.per_episode.filter((one) => !one.success).length;
    assert.ok(cells.slice(0, failed).every((one) => one.outcome !== 'success'));
    for (const cell of cells) assert.equal(cell.outcome === 'success', file.per_episode.find((one) => one.index === cell.index).success);
  });
  const off = file.per_episode.find((one) => one.first_bad);
  // folders that somebody gives may have none; a policy of 300 steps is off somewhere
  assert.ok(off || !process.env.ETUDE_LAB, 'no scene of the lab has a first bad decision');
  if (off) await open(`${pages.evaluation}&scene=${off.index}`, async (page) => {
    const { module, error_cm, decision } = off.first_bad;
    assert.equal(await page.locator('[data-first-bad]').getAttribute('data-first-bad'), module);
    const said = await text(page, '[data-first-bad]');
    assert.ok(said.includes(`decision ${decision + 1}`), said);
    assert.ok(Math.abs(number(said.split(' ')[2]) - error_cm) <= 0.05 * error_cm, said);  // two digits
  });
});

test('Evaluation: success by checkpoint has a row with its interval for each evaluation of the run', async () => {
  const evaluation = source('eval');
  if (!evaluation) return;
  const sources = home.sources.filter((one) => one.kind === 'eval').slice(0, 25);
  const reports = await Promise.all(sources.map((one) => get(`/evals/${one.id}`)));
  const own = reports.find((one) => one.id === evaluation.id);
  if (!own.run_id || !own.checkpoint) return;
  const wanted = reports.filter((one) => one.run_id === own.run_id && one.checkpoint?.step != null).sort((a, b) => a.checkpoint.step - b.checkpoint.step || a.name.localeCompare(b.name))
    .map((one) => ({ step: one.checkpoint.step, ...readJson(join(folderOf(sources.find((of) => of.id === one.id), 'eval.json'), 'eval.json')).overall.success }));
  await open(pages.evaluation, async (page) => {
    await page.waitForFunction((n) => document.querySelectorAll('[data-by-checkpoint] .dot-row').length === n, wanted.length);
    const rows = await page.locator('[data-by-checkpoint] .dot-row').evaluateAll((all) => all.map((one) => one.textContent));
    rows.forEach((row, i) => {
      assert.ok(row.replaceAll(',', '').startsWith(`step ${wanted[i].step}`), `${row}: of step ${wanted[i].step}`);
      assert.equal(Number(/, (\d+) of \d+, 95 % interval/.exec(row)[1]), wanted[i].successes);
      assert.ok(row.includes(`[${(100 * wanted[i].low).toFixed(1)} ${(100 * wanted[i].high).toFixed(1)}]`), row);
    });
  });
});

test('Evaluation: a comparison says which runs the checkpoints are of, and what their configs differ in', async () => {
  const [a, b] = home.sources.filter((one) => one.kind === 'eval');
  if (!b) return;
  const [first, second] = await Promise.all([a, b].map((one) => get(`/evals/${one.id}`)));
  const kind = !first.run_id || !second.run_id ? 'unknown' : first.run_id === second.run_id ? 'one' : 'two';
  await open(`/evaluation?eval=${a.id}&vs=${b.id}`, async (page) => {
    await page.waitForSelector(`[data-runs=${kind}]`);
    if (kind !== 'two') return;
    const diff = await get(`/diff?a=${first.run_id}&b=${second.run_id}`);
    await page.waitForSelector(`h2:has-text("What changed between the runs: ${diff.total.toLocaleString('en-US')} ")`);
  });
});

test('Evaluation: a pair has the counts of the files, or is refused', async () => {
  const [a, b] = home.sources.filter((one) => one.kind === 'eval');
  if (!b) return;
  const [first, second] = [a, b].map((one) => readJson(join(folderOf(one, 'eval.json'), 'eval.json')));
  const other = new Map(second.per_episode.map((one) => [`${one.seed} ${one.task} ${one.target}`, one.success]));
  const shared = first.per_episode.filter((one) => other.has(`${one.seed} ${one.task} ${one.target}`));
  await open(`/evaluation?eval=${a.id}&vs=${b.id}`, async (page) => {
    await page.waitForSelector('[data-pair], .problem');
    if (await page.locator('[data-pair]').count() === 0) return;
    const cells = await page.locator('[data-pair] table tr').last().locator('td').allInnerTexts();
    const count = (x, y) => shared.filter((one) => one.success === x && other.get(`${one.seed} ${one.task} ${one.target}`) === y).length;
    assert.deepEqual(cells.slice(1, 6).map(Number), [shared.length, count(true, true), count(true, false), count(false, true), count(false, false)]);
  });
});

test('Dataset: rows and filters count what lies in the folder', async () => {
  const dataset = source('dataset', 'demonstrations');
  if (!dataset) return;
  const folder = folderOf(dataset, 'dataset.json');
  const { statistics } = readJson(join(folder, 'dataset.json'));
  const total = async (page) => number((await text(page, '[data-total]')).split(' ')[0]);
  await open(pages.dataset, async (page) => assert.equal(await total(page), episodeFiles(folder).length));
  const [task, count] = Object.entries(statistics?.tasks ?? {})[0] ?? [];
  if (task && statistics.episodes === episodeFiles(folder).length) await open(`${pages.dataset}&task=${task}`, async (page) => assert.equal(await total(page), count));
});

test('Dataset: episodes by task and target are those of the journal', async () => {
  const dataset = source('dataset', 'demonstrations');
  if (!dataset) return;
  const journal = readLines(join(folderOf(dataset, 'dataset.json'), 'commits.jsonl'));
  if (!journal.length) return;
  await open(pages.dataset, async (page) => {
    await page.waitForSelector('[data-task-target]');
    const rows = await page.locator('[data-task-target] tr').evaluateAll((all) => all.map((row) => [...row.children].map((cell) => cell.textContent.trim())));
    const [[, ...tasks], ...targets] = rows;
    for (const [target, ...cells] of targets) {
      cells.forEach((cell, i) => assert.equal(cell === '·' ? 0 : number(cell), journal.filter((one) => one.task === tasks[i] && one.target === target).length, `${tasks[i]} ${target}`));
    }
    assert.equal(targets.length, new Set(journal.map((one) => one.target)).size);
  });
});

test('Generation: attempts are those committed and those of attempts.jsonl', async () => {
  const dataset = source('dataset', 'demonstrations');
  if (!dataset) return;
  const folder = folderOf(dataset, 'dataset.json');
  const failed = readLines(join(folder, 'attempts.jsonl')).filter((one) => one.outcome !== 'success').length;
  await open(pages.generation, async (page) => {
    const numbers = (await page.locator('[data-attempts-summary] b').allInnerTexts()).map(number);
    const committed = episodeFiles(folder).length;
    assert.ok(numbers.includes(committed + failed) && numbers.includes(committed) && numbers.includes(failed), numbers.join());
  });
});

test('Generation: failures and attempts are those of the robot that is chosen', async () => {
  const dataset = source('dataset', 'demonstrations');
  if (!dataset) return;
  const campaign = await get(`/campaigns/${dataset.id}`);
  // a lab has one robot and fails seldom: the counts are put into what the gateway answers
  const [task] = campaign.tasks;
  const failures_by = [['ur5', 3], ['panda', 2]].map(([robot, count]) => ({ reason: 'plan_failed', stage: 'reach', task, robot, count }));
  const { page, context, wrong } = await openPage(browser, gateway.address);
  try {
    await page.route(`**/api/v1/campaigns/${dataset.id}`, (route) => route.fulfill({ json: { ...campaign, robots: ['ur5', 'panda'], failures_by } }));
    const cell = () => page.locator('[data-matrix] tbody tr td.strong').first().innerText();
    await visit(page, `${gateway.address}${pages.generation}`);
    assert.equal(await cell(), '5');
    const asked = page.waitForRequest((request) => /\/attempts\?.*robot=panda/.test(request.url()));
    await page.getByRole('combobox', { name: 'Robot' }).selectOption('panda');
    await asked;
    await page.waitForURL('**robot=panda**');
    assert.equal(await cell(), '2');
    assert.match(await page.locator('[data-matrix] tbody a').first().getAttribute('href'), /robot=panda/);
    await page.getByLabel('remove the filter robot').click();
    await page.waitForFunction(() => document.querySelector('[data-matrix] tbody td.strong')?.textContent === '5');
    assert.deepEqual(wrong, []);
  } finally {
    await context.close();
  }
});

test('Generation: a seed is found and opened by keyboard', async () => {
  const dataset = source('dataset', 'demonstrations');
  if (!dataset) return;
  const first = Number.parseInt(episodeFiles(folderOf(dataset, 'dataset.json'))[0], 10);
  await open(pages.generation, async (page) => {
    const map = page.locator('[data-seed-map]');
    await map.focus();
    await map.press('End');
    await map.press('Home');
    assert.match(await text(page, '[data-seed-at]'), /^#0: /);
    for (let i = 0; i < first; i++) await map.press('ArrowRight');
    assert.match(await text(page, '[data-seed-at]'), new RegExp(`^#${first}: committed`));
    await map.press('Enter');
    await page.waitForURL(`**/episode/${dataset.id}/${first}`);
  });
});


test('Attempt: what is said of a failed one is its line of attempts.jsonl', async () => {
  if (!pages.attempt) return;
  const { pathname, searchParams } = new URL(pages.attempt, gateway.address);
  const [index, attempt] = [Number(pathname.split('/').at(-1)), Number(searchParams.get('attempt'))];
  const lines = readLines(join(folderOf(source('dataset', 'demonstrations'), 'dataset.json'), 'attempts.jsonl'));
  const line = lines.find((one) => one.index === index && one.attempt === attempt);
  await open(pages.attempt, async (page) => {
    assert.equal(await text(page, '.page-head .figure'), `#${index}.${attempt}`);
    assert.equal(await text(page, '[data-reason]'), line.details.reason || line.outcome);
    assert.equal(await text(page, '[data-seed]'), line.seed);
    assert.match(await text(page, '.page-head .chip'), new RegExp(`${line.outcome}$`));
    assert.match(await text(page, '.command code'), new RegExp(`--index ${index} --attempt ${attempt} `));
  });
});

test('Dataset: of 10,000 episodes the first row is there within a second', { timeout: 120000 }, async (t) => {
  const dataset = source('dataset', 'demonstrations');
  if (!dataset) return;
  const work = mkdtempSync(join(tmpdir(), `etude-test-${process.pid}-`));
  try {
    const many = makeMany(folderOf(dataset, 'dataset.json'), join(work, 'many'), 10000);
    if (!many) return;
    // each time of a gateway that has just begun; best of three, because what else the machine does takes its share
    const times = [];
    while (times.length < 3 && !(Math.min(...times) < 1000)) {
      const own = await startGateway([many], 0, ['--no-bus']);
      const { page, context, wrong } = await openPage(browser, own.address);
      const began = performance.now();
      await page.goto(`${own.address}/dataset?dataset=many`, { waitUntil: 'commit' });
      await page.waitForSelector('[role=row][data-id]');
      times.push(performance.now() - began);
      assert.equal(await page.locator('[role=row][data-id]').first().getAttribute('data-id'), '9999');
      assert.equal(number((await text(page, '[data-total]')).split(' ')[0]), 10000);
      assert.ok(await page.locator('[role=row][data-id]').count() < 200, 'only rows in view exist');
      assert.equal(await text(page, '[data-page]'), 'episodes 1 to 200 of 10,000');
      await page.getByRole('button', { name: 'After' }).click();
      await page.waitForSelector('[role=row][data-id="9799"]');
      assert.equal(await text(page, '[data-page]'), 'episodes 201 to 400 of 10,000');
      // the address is of the page: it shows the same to whoever opens it, and leads back
      await page.goto(page.url());
      await page.waitForSelector('[role=row][data-id="9799"]');
      assert.equal(await text(page, '[data-page]'), 'episodes 201 to 400 of 10,000');
      await page.getByRole('button', { name: 'Before' }).click();
      await page.waitForSelector('[role=row][data-id="9999"]');
      assert.deepEqual(wrong, []);
      await context.close();
      await own.stop();
    }
    t.diagnostic(`first row after ${times.map((one) => one.toFixed(0)).join(', ')} ms`);
    assert.ok(Math.min(...times) < 1000, `first row after ${times.map((one) => one.toFixed(0)).join(', ')} ms`);
  } finally {
    rmSync(work, { recursive: true, force: true });
  }
});

test('Fleet: what workers did is what the journal of the dataset says', async () => {
  const all = home.sources.filter((one) => one.kind === 'dataset' && one.role === 'demonstrations');
  const fleet = await get('/fleet');
  if (fleet.live || all.length !== 1) return;
  const [journal, attempts] = ['commits.jsonl', 'attempts.jsonl'].map((name) => readLines(join(folderOf(all[0], 'dataset.json'), name)));
  await open(pages.fleet, async (page) => {
    const workers = new Map();
    for (const one of journal) if (one.worker) workers.set(one.worker, (workers.get(one.worker) ?? 0) + 1);
    const failures = new Map();
    // a recheck that differs is no failure of the attempt
    for (const { outcome, details } of attempts) if (details?.worker && outcome !== 'recheck_mismatch') failures.set(details.worker, (failures.get(details.worker) ?? 0) + 1);
    for (const worker of failures.keys()) if (!workers.has(worker)) workers.set(worker, 0);
    assert.equal(fleet.workers, workers.size);
    for (const [worker, episodes] of workers) {
      const row = await page.locator(`[role=row][data-id="${worker}"]`).innerText();
      assert.ok(row.split(/\s+/).includes(String(episodes)), `${worker}: ${episodes} episodes, the page has ${row}`);
      assert.equal(await page.locator(`[role=row][data-id="${worker}"] [data-failures]`).getAttribute('data-failures'), String(failures.get(worker) ?? 0));
    }
  });
});

test('Fleet leads to what a worker made', async () => {
  const dataset = source('dataset', 'demonstrations');
  const fleet = await get('/fleet');
  const worker = fleet.hosts.flatMap((host) => host.workers).find((one) => one.campaign === dataset?.id && one.episodes > 0);
  if (fleet.live || !worker) return;
  const made = readLines(join(folderOf(dataset, 'dataset.json'), 'commits.jsonl')).filter((one) => one.worker === worker.worker).length;
  await open(pages.fleet, async (page) => {
    await page.locator(`[role=row][data-id="${worker.worker}"] a`).click();
    await page.waitForURL(`**/dataset?dataset=${dataset.id}&worker=**`);
    await page.waitForFunction((n) => Number.parseInt((document.querySelector('[data-total]')?.textContent ?? '').replaceAll(',', ''), 10) === n, made);
  });
});

test('Logs: lines of the files, and none that a text is not in', async () => {
  const logs = await get('/logs?limit=200');
  if (!logs.lines.length) return;
  const word = /[a-z]{5,}/.exec(logs.lines.at(-1).text)?.[0] ?? '';
  await open(`/logs?q=${word}`, async (page) => {
    const lines = await page.locator('.log-box .log li').allInnerTexts();
    assert.ok(lines.length > 0 && lines.every((one) => one.toLowerCase().includes(word)), lines.find((one) => !one.toLowerCase().includes(word)));
  });
});

test('Episode: the picture follows the step, space is drawn', async () => {
  if (!pages.episode) return;
  const id = source('dataset', 'demonstrations').id;
  const episode = await get(`/datasets/${id}/episodes/0`);
  await open(pages.episode, async (page) => {
    assert.equal(await text(page, '[data-seed]'), episode.seed);
    const slider = page.locator('input[type=range]');
    for (let i = 0; i < 20; i++) {
      const step = (i * 7919) % episode.steps;
      await slider.evaluate((element, value) => { element.value = value; element.dispatchEvent(new Event('input', { bubbles: true })); }, String(step));
      const k = Math.min(episode.cameras[0].frames - 1, Math.floor(step / episode.image_stride));
      await page.waitForSelector(`canvas[data-picture="${k}"]`, { timeout: 5000 });
    }
    // pixels of the stored picture against what the server gives as raw bytes
    const answer = await fetch(`${gateway.address}/api/v1/datasets/${id}/episodes/0/pictures/${episode.cameras[0].name}/0.rgb`);
    const bytes = new Uint8Array(await answer.arrayBuffer());
    await slider.evaluate((element) => { element.value = '0'; element.dispatchEvent(new Event('input', { bubbles: true })); });
    await page.waitForSelector('canvas[data-picture="0"]');
    const shown = await page.locator('canvas[data-picture]').evaluate((element) => [...element.getContext('2d').getImageData(0, 0, element.width, element.height).data]);
    assert.deepEqual(shown.filter((_value, i) => i % 4 !== 3), [...bytes]);
    await page.waitForSelector('.view3d canvas');
    const image = await page.locator('.view3d').screenshot();
    assert.ok(image.length > 4000, `the 3D view is ${image.length} bytes of PNG: nothing was drawn`);
  });
});

test('Checkpoints: as many rows as files, and the SHA-256 of the chosen one', async () => {
  const run = source('run');
  if (!run) return;
  const files = checkpoints(folderOf(run, 'metrics.jsonl'));
  if (!files.length) return;
  await open(`/checkpoints?run=${run.id}&file=${files[0].name}`, async (page) => {
    assert.equal(await page.locator('[role=row][data-id]').count(), files.length);
    await page.waitForFunction((hash) => document.querySelector('[data-sha256]')?.textContent === hash, files[0].sha256, { timeout: 30000 });
  });
});

test('Inside: a box for each module of the config, all reachable by keyboard', async () => {
  if (!pages.inside) return;
  const graph = await get(`/runs/${source('run').id}/graph`);
  await open(pages.inside, async (page) => {
    assert.equal(await page.locator('[data-node]').count(), graph.nodes.length);
    // errors as the newest checkpoint's own header has them, in the units of people
    const header = checkpointHeader(folderOf(source('run'), 'metrics.jsonl'));
    for (const [name, { error, trained_steps }] of Object.entries(JSON.parse(header?.modules ?? '{}'))) {
      const said = (await page.locator(`[data-node="${name}"]`).textContent()) ?? '';
      if (!trained_steps || error === null) continue;
      const shown = number(/([\d.,e-]+) (?:% wrong|px|cm)$/.exec(said)?.[1] ?? '');
      const scale = said.endsWith('px') ? 1 : 100;
      assert.ok(Math.abs(shown - scale * error) <= 0.051 * Math.abs(scale * error) + 1e-9, `${name}: page "${said}", file ${error}`);
    }
    await page.locator(`[data-node="${graph.nodes[0].name}"]`).press('Enter');
    await page.waitForURL(`**module=${graph.nodes[0].name}**`);
  });
});

test('Inside: what an evaluation kept of a rollout is walked through, though nobody serves the policy', async () => {
  if (!pages.kept) return;
  const folder = folderOf(source('eval'), 'eval.json');
  const row = readJson(join(folder, 'eval.json')).per_episode.find((one) => one.insight);
  const decisions = insights(join(folder, row.insight));
  const last = decisions.findLastIndex((one) => one.modules);
  const before = decisions.slice(0, last).findLastIndex((one) => one.modules);
  await open(`${pages.evaluation}&scene=${row.index}`, async (page) => {
    await page.click('a:has-text("What the policy said")');
    await page.waitForSelector('[data-said]');
  });
  await open(`${pages.kept}&scene=${row.index}&decision=${last}`, async (page) => {
    const shows = async (k) => {
      await page.waitForSelector(`[data-decision="${k}"]`);
      await settle(page);
      const { modules, checkpoint_step } = decisions[k];
      assert.equal(number(await page.locator('[data-kept-step]').getAttribute('data-kept-step')), checkpoint_step);
      assert.deepEqual(await page.locator('[data-said] tr[data-module]').evaluateAll((all) => all.map((one) => one.dataset.module)), Object.keys(modules));
      for (const [name, said] of Object.entries(modules)) if (typeof said.value === 'string') assert.ok((await text(page, `[data-said] tr[data-module="${name}"]`)).includes(said.value), name);
    };
    await shows(last);
    if (before < 0) return;
    await page.keyboard.press('ArrowLeft');
    await shows(before);
  });
});

test('keys go to pages, back and forward work, unknown addresses say so', async () => {
  await open('/', async (page) => {
    await page.keyboard.press('g');
    await page.keyboard.press('l');
    await page.waitForURL('**/logs');
    await page.goBack();
    await page.waitForSelector('[data-overview-sentence]');
    await page.goForward();
    await page.waitForURL('**/logs');
    await page.keyboard.press('?');
    await page.waitForSelector('dialog[open]');
    await page.keyboard.press('Escape');
  });
  const { page, context } = await openPage(browser, gateway.address);
  await page.goto(`${gateway.address}/nowhere`);
  await page.waitForSelector('text=There is no such page');
  await context.close();
});

test('the gateway is killed and started again under every page, and each shows what it showed', { timeout: 400000 }, async () => {
  const opened = await openAll(browser, gateway, pages);
  try {
    const before = new Map();
    for (const { name, page, wrong } of opened) {
      assert.deepEqual(wrong, [], name);
      before.set(name, await shown(name, page));
    }
    assert.ok([...before.values()].some((one) => one.length), 'no page shows a figure');
    gateway = await restart(gateway, opened, (port) => startGateway(dirs, port, onDomain));
    await cameBack(opened);
    // where something is made meanwhile figures grow
    if ((await get('/fleet')).live || (source('run') && (await get(`/runs/${source('run').id}`)).live)) return;
    for (const { name, page } of opened) await shows(name, page, before.get(name));
  } finally {
    await closeAll(opened);
  }
});
