// SPDX-License-Identifier: Apache-2.0
// The README's pictures of the pages, and a moving one of a play session, of a gateway that runs over a dataset, a run and
// its evaluation, with a policy server of that run on its bus:
//   node pictures.mjs http://127.0.0.1:8080 TOKEN_FILE OUT [SENTENCE...]
// Writes OUT/page-{training,inside,evaluation,play}.jpg and OUT/play.webp (made with img2webp, Debian's webp).
import { execFileSync } from 'node:child_process';
import { mkdirSync, mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { addresses, launch, openPage, settle, visit } from './browser.mjs';

const [base, tokenFile, out, ...given] = process.argv.slice(2);
if (!out) {
  console.error('pictures: node pictures.mjs ADDRESS TOKEN_FILE OUT [SENTENCE...]');
  process.exit(2);
}
const kScene = 700; // of the quickstart's campaign: behind its 600 demonstrations
const kEvery = 200; // ms from one picture of the session to the next
const kLongest = 60000; // ms of a sentence
const kQuality = 55; // of the moving picture: a README is loaded by everybody
mkdirSync(out, { recursive: true });
const work = mkdtempSync(join(tmpdir(), `etude-test-${process.pid}-`));
const browser = await launch();
const still = (page, name, clip) => page.screenshot({ path: join(out, `page-${name}.jpg`), type: 'jpeg', quality: 85, ...(clip ? { clip } : {}) });

async function takePages() {
  const of = await addresses(base);
  for (const name of ['training', 'inside', 'evaluation']) {
    const { page, context } = await openPage(browser, base, { width: 1280, height: 860 });
    await visit(page, base + of[name]);
    await page.waitForLoadState('networkidle').catch(() => undefined);
    await settle(page);
    await still(page, name);
    await context.close();
  }
}

/** The session's page with a scene that stands, and the objects that a sentence can be about. */
async function openSession(page) {
  await visit(page, `${base}/play`);
  await page.waitForFunction(() => [...document.querySelectorAll('select')].some((one) => [...one.options].some((option) => /@[0-9a-f]{16}$/.test(option.value))), undefined, { timeout: 30000 });
  await page.getByLabel('Token').fill(readFileSync(tokenFile, 'utf8').trim());
  await page.getByLabel('Number').fill(String(kScene));
  await page.getByRole('button', { name: 'Open', exact: true }).click();
  await page.waitForURL('**session=play-**');
  await page.waitForSelector('.play-picture img', { timeout: 120000 });
  const session = new URL(page.url()).searchParams.get('session');
  const state = await (await fetch(`${base}/api/v1/play/sessions/${session}`)).json();
  return state.scene.objects.map((one) => one.name);
}

/** Where the scene, the sentence and the judge are: what is above them names files of this machine. */
async function placeOf(page) {
  await page.locator('.play').evaluate((one) => one.scrollIntoView());
  return page.locator('.play').evaluate((one) => {
    const play = one.getBoundingClientRect();
    const bottom = Math.min(window.innerHeight, document.querySelector('.play-picture').getBoundingClientRect().bottom);
    return { x: play.x, y: Math.max(0, play.y), width: play.width, height: bottom - Math.max(0, play.y) };
  });
}

/** Pictures of the page from now until `done`, each with the time that it stands. */
async function record(page, clip, taken, done) {
  const begun = Date.now();
  let ended = false;
  void done.then(() => { ended = true; }, () => { ended = true; });
  for (let last = false; !last && Date.now() - begun < kLongest;) {
    last = ended; // one more behind the end
    const at = Date.now();
    const path = join(work, `${String(taken.length).padStart(5, '0')}.png`);
    await page.screenshot({ path, clip });
    const left = kEvery - (Date.now() - at);
    if (left > 0) await page.waitForTimeout(left);
    taken.push({ path, ms: Date.now() - at });
  }
}

/** Types it, lets the policy do it, and waits for the judge's word. */
async function obey(page, clip, sentence, taken) {
  await page.getByLabel('Sentence').fill(sentence);
  await page.waitForSelector('[data-meaning]');
  await record(page, clip, taken, page.waitForTimeout(600));
  await page.getByLabel('Sentence').press('Enter');
  const under = page.waitForFunction(() => /under way/.test(document.querySelector('.verdict .chip')?.textContent ?? ''), undefined, { timeout: 20000 });
  const judged = under.then(() => page.waitForFunction(() => !/under way/.test(document.querySelector('.verdict .chip')?.textContent ?? 'under way'), undefined, { timeout: kLongest }));
  const middle = under.then(() => page.waitForTimeout(3000)).then(() => still(page, 'play', clip));
  await record(page, clip, taken, judged);
  await Promise.allSettled([middle, judged]);
}

async function takeSession() {
  const { page, context } = await openPage(browser, base, { width: 1120, height: 900 });
  const names = await openSession(page);
  const objects = ['coke', 'milk', 'pepsi', 'bread', 'bottle', 'cube'].filter((name) => names.includes(name));
  const sentences = given.length ? given : [`push the ${objects[0]}`, `pick up the ${objects[1] ?? objects[0]}`];
  const taken = [];
  const clip = await placeOf(page);
  for (const sentence of sentences) await obey(page, clip, sentence, taken);
  taken.at(-1).ms += 1500;
  await page.getByRole('button', { name: 'Close', exact: true }).click();
  await context.close();
  const frames = taken.flatMap(({ path, ms }) => ['-d', String(ms), path]);
  execFileSync('img2webp', ['-loop', '0', '-lossy', '-q', String(kQuality), '-m', '4', ...frames, '-o', join(out, 'play.webp')], { stdio: ['ignore', 'ignore', 'inherit'] });
}

try {
  await takePages();
  await takeSession();
} finally {
  await browser.close();
  rmSync(work, { recursive: true, force: true });
}
