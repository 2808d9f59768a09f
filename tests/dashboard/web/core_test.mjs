// SPDX-License-Identifier: Apache-2.0
// What the pages compute themselves: intervals, formats, safetensors. Needs no browser and no gateway.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';
import { createRequire } from 'node:module';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';

const web = join(dirname(fileURLToPath(import.meta.url)), '../../../dashboard/web');
const { build } = createRequire(join(web, 'package.json'))('esbuild');

/** A module of the pages, compiled in memory. */
async function load(name) {
  const result = await build({ entryPoints: [join(web, 'src/core', name)], bundle: true, format: 'esm', write: false, logLevel: 'silent' });
  return import(`data:text/javascript;base64,${Buffer.from(result.outputFiles[0].contents).toString('base64')}`);
}

test('the axis of proportions begins at a multiple of ten below the lowest bound', async () => {
  const { axisStart } = await load('stats.ts');
  assert.equal(axisStart([0.971, 0.917]), 0.9);
  assert.equal(axisStart([0.862, 0.742]), 0.7);
  assert.equal(axisStart([0.9]), 0.8);
  assert.equal(axisStart([0.02]), 0);
});

test('a time of another day says which', async () => {
  const { clock } = await load('format.ts');
  const today = new Date();
  assert.match(clock(today.getTime()), /^\d\d:\d\d:\d\d$/);
  assert.match(clock(today.getTime() - 3 * 86400e3), /^\d{4}-\d\d-\d\d \d\d:\d\d:\d\d$/);
  assert.match(clock(today.getTime() - 3 * 86400e3, false), /^\d{4}-\d\d-\d\d \d\d:\d\d$/);
});

test('a summary counts what is not finite and leaves it out', async () => {
  const { summarize } = await load('stats.ts');
  assert.deepEqual(summarize([3, null, 1, NaN, 2, undefined]), { n: 3, missing: 2, min: 1, max: 3, last: 2 });
});

test('smoothing does not depend on how densely is logged', async () => {
  const { smooth } = await load('stats.ts');
  const sparse = smooth([0, 100], [1, 0], 50);
  const dense = smooth([0, 50, 100], [1, null, 0], 50);
  assert.ok(Math.abs(sparse[1] - dense[2]) < 1e-12);
  assert.equal(dense[1], null);
});

test('a page of a listing in the address is of that listing alone', async () => {
  const { readPage, writePage } = await load('paging.ts');
  const [listing, other] = ['/datasets/d/episodes?sort=-index', '/datasets/d/episodes?sort=-steps'];
  const text = writePage(listing, 3, '12-"a b"\n-7');
  assert.deepEqual(readPage(listing, text), { depth: 3, cursor: '12-"a b"\n-7' });
  assert.equal(readPage(other, text), null);
  for (const bad of ['', '3', '0-' + text.slice(2), '-1' + text.slice(1), text.slice(0, text.indexOf('-', 2) + 1)]) assert.equal(readPage(listing, bad), null, bad);
});

test('a walk through decisions skips those of which nothing was kept', async () => {
  const { decisionAt, decisionBeside } = await load('decisions.ts');
  const all = [false, true, false, false, true, false].map((kept) => ({ kept }));
  assert.deepEqual([0, 1, 2, 4, 5, 99].map((wanted) => decisionAt(all, wanted)), [1, 1, 4, 4, 4, 4]);
  assert.equal(decisionAt([{ kept: false }], 0), -1);
  assert.equal(decisionAt([], 0), -1);
  assert.equal(decisionBeside(all, 1, 1), 4);
  assert.equal(decisionBeside(all, 4, -1), 1);
  assert.equal(decisionBeside(all, 4, 1), 4);
  assert.equal(decisionBeside(all, 1, -1), 1);
});

test('what a module is off stands in the unit of what it decodes', async () => {
  const { meanError } = await load('says.ts');
  const said = [['class', 0.25], ['task', 0.02], ['pixel', 1.5], ['position', 0.02], ['trajectory', 0.013], [null, 0.02], ['class', null]];
  assert.deepEqual(said.map(([quantity, error]) => meanError({ quantity, error })), ['25 % wrong', '2 % wrong', '1.5 px', '2 cm', '1.3 cm', '0.02', '–']);
});

test("a play session's policy is shown as one that was asked, without a truth to hold it against", async () => {
  const { insightOf, isOf } = await load('session.ts');
  const { plan } = await load('says.ts');
  const session = { run: 'base@0123', sentence: 'push it', waypoints: [[1, 2, 3, 1, 0, 0, 0, 1, 0, 0.5]] };
  const seen = { number: 1, checkpoint_step: 7, modules: { LANG: { value: 'coke' } }, attention: {}, view: { u: 0, v: 0, width: 4, height: 3 } };
  const insight = insightOf(seen, session);
  assert.deepEqual(insight.waypoints, [[1, 2, 3, 0.5]]);
  assert.equal(insight.modules.LANG.value, 'coke');
  assert.deepEqual(plan(insight), { says: '1 waypoints', error: '', change: '–' });
  assert.equal(insightOf({ ...seen, number: 0 }, session), undefined);
  assert.equal(insightOf(undefined, session), undefined);
  assert.ok(isOf(session, '0123456789abcdef'));
  assert.ok(!isOf(session, '9123456789abcdef'));
  assert.ok(!isOf(session, null));
  assert.ok(!isOf({ run: 'base' }, '0123456789abcdef'));
});

test('a rate is split by its share where both are known', async () => {
  const { split } = await load('stats.ts');
  assert.deepEqual(split({ x: [50, 100, 150], last: [800, 400, 100] }, { x: [50, 150], last: [0.25, 1.5] }), { x: [50, 150], part: [200, 100], rest: [600, 0] });
});

test('hidden parts of a picture go into the address and come back', async () => {
  const { readRectangles, writeRectangles } = await load('rectangles.ts');
  assert.deepEqual(readRectangles('100,80,12,12;1,2,3,4'), [[100, 80, 12, 12], [1, 2, 3, 4]]);
  assert.deepEqual(readRectangles(';;nonsense;1,2,3;1,2,0,4;1,2,3,x'), []);
  assert.equal(writeRectangles([[1.4, 2.6, 3, 4], [5, 6, 7, 8]]), '1,3,3,4;5,6,7,8');
  assert.equal(readRectangles(Array(20).fill('1,1,1,1').join(';')).length, 8);
});

test('arrow keys move the brush and size it, and never out of the picture', async () => {
  const { moved } = await load('rectangles.ts');
  const whole = { width: 64, height: 48 };
  assert.deepEqual(moved([8, 8, 16, 16], 'ArrowRight', false, whole), [12, 8, 16, 16]);
  assert.deepEqual(moved([8, 8, 16, 16], 'ArrowUp', true, whole), [8, 8, 16, 12]);
  assert.deepEqual(moved([2, 8, 16, 16], 'ArrowLeft', false, whole), [0, 8, 16, 16]);
  assert.deepEqual(moved([47, 8, 16, 16], 'ArrowRight', false, whole), [48, 8, 16, 16]);
  assert.deepEqual(moved([8, 8, 16, 4], 'ArrowUp', true, whole), [8, 8, 16, 4]);
  assert.equal(moved([8, 8, 16, 16], 'Tab', false, whole), null);
});

test('what modules say, against the truth and against another answer', async () => {
  const { apart, brief, difference, errorText, plan, words } = await load('says.ts');
  const position = { quantity: 'position', unit: 'm', value: [0.1, 0.25, 0.04] };
  assert.equal(words({ value: 'coke', probability: 0.971 }), 'coke 0.97');
  assert.equal(words(position), '(0.1, 0.25, 0.04) m');
  assert.equal(brief({ ...position, value: [...position.value, 1, 0, 0, 0, 1, 0] }), '(10, 25, 4) cm');
  assert.equal(brief({ unit: 'px', value: [12.34, 5] }), '(12.3, 5) px');
  assert.equal(difference(position, { ...position, value: [0.1, 0.25, 0.07] }), '3 cm');
  assert.equal(difference({ value: 'coke' }, { value: 'milk' }), 'another');
  assert.equal(errorText(undefined), '');
  assert.equal(errorText({ truth: 'coke', error: 0, unit: '-' }), 'right');
  assert.equal(errorText({ truth: 'coke', error: 1, unit: '-' }), 'wrong: coke');
  assert.equal(errorText({ truth: [0, 0, 0], error: 0.015, unit: 'm', turned_rad: Math.PI / 60 }), '1.5 cm off, 3°');
  assert.equal(errorText({ truth: [1, 2], error: 4, unit: 'px' }), '4 px off');
  assert.equal(apart([[0, 0, 0, 1], [0, 0, 0, 1]], [[3, 4, 0, 0]]), 5);
  assert.equal(apart([], [[3, 4, 0, 0]]), null);
  const of = { waypoints: [[0, 0, 0, 1]], what_if_waypoints: [[0, 0, 0.02, 1]], truth: { waypoints_error_m: 0.01 } };
  assert.deepEqual(plan(of), { says: '1 waypoints', error: '1 cm off', change: '2 cm' });
});

test('numbers as pages write them', async () => {
  const { age, bytes, duration, number, percent, probability } = await load('format.ts');
  assert.deepEqual([number(0.15321), number(6589), number(0), number(null), number(4.8e-9)], ['0.153', '6,589', '0', '–', '4.8e-9']);
  assert.deepEqual([number(999.7), number(99.6, 2), number(-999.96), number(99.94)], ['1,000', '100', '-1,000', '99.9'], 'no exponent where rounding adds a digit');
  assert.deepEqual([percent(1), percent(0.9875), percent(null)], ['100 %', '98.8 %', '–']);
  assert.deepEqual([duration(588), duration(3725), duration(null)], ['9:48', '1:02:05', '–']);
  assert.deepEqual([age(300), age(14000), age(240000)], ['0.3 s', '14 s', '4 min']);
  assert.deepEqual([bytes(999), bytes(999600), bytes(4680000)], ['999 B', '1,000 kB', '4.68 MB']);
  assert.deepEqual([probability(0.0001), probability(0.69)], ['< 0.001', '0.69']);
});

test('safetensors: header, offsets, types', async () => {
  const { readSafetensors } = await load('safetensors.ts');
  const header = Buffer.from(JSON.stringify({ __metadata__: { x: 'step' }, a: { dtype: 'U8', shape: [1], data_offsets: [0, 1] }, b: { dtype: 'F32', shape: [2], data_offsets: [1, 9] } }));
  const length = Buffer.alloc(8);
  length.writeBigUInt64LE(BigInt(header.length));
  const floats = Buffer.alloc(8);
  floats.writeFloatLE(0.5, 0);
  floats.writeFloatLE(-2, 4);
  const file = Buffer.concat([length, header, Buffer.from([7]), floats]);
  const { tensors, metadata } = readSafetensors(file.buffer.slice(file.byteOffset, file.byteOffset + file.length));
  assert.deepEqual([[...tensors.get('a').values], [...tensors.get('b').values], metadata.x], [[7], [0.5, -2], 'step']);
  assert.throws(() => readSafetensors(file.buffer.slice(file.byteOffset, file.byteOffset + 20)), /header of/);
});

test('ticks are spans in the address, and bounded', async () => {
  const { mostTicks, readTicks, writeTicks } = await load('ticks.ts');
  assert.equal(writeTicks([7, 2, 1, 0, 3, 3, 10]), '0-3,7,10');
  assert.deepEqual([...readTicks('0-3,7,10')], [0, 1, 2, 3, 7, 10]);
  assert.equal(writeTicks(readTicks('')), '');
  assert.deepEqual([...readTicks('5,x,-2,3-1,<b>')], [5]);
  assert.equal(readTicks('0-999999999').size, mostTicks);
});

test('a tie is rounded to the even digit, as the programs do', async () => {
  const { percent, rounded } = await load('format.ts');
  assert.equal(percent(385 / 400), '96.2 %');
  assert.equal(percent(0.96375), '96.4 %');
  assert.equal(rounded(0.75, 1), '0.8');
  assert.equal(percent(1), '100 %');
});

test('a path that is not UTF-8 is shown as it is written', async () => {
  const { partsOf } = await load('address.ts');
  assert.deepEqual(partsOf('/episode/a%20b/3'), ['episode', 'a b', '3']);
  assert.deepEqual(partsOf('/%E0%A4/x'), ['%E0%A4', 'x']);
  assert.deepEqual(partsOf('//'), []);
});

test('another source takes no filter, tick or selection of the one before with it', async () => {
  const { withSource } = await load('address.ts');
  const query = new URLSearchParams('dataset=a&run=r&ticks=1-3&from=200&page=2-x&scene=4&vs=e&y=log&smooth=200&x=elapsed&range=1..2');
  assert.equal(withSource(query, 'dataset', 'b').toString(), 'dataset=b&run=r&y=log&smooth=200&x=elapsed');
  assert.equal(withSource(new URLSearchParams('key=train'), 'eval', 'e').toString(), 'eval=e');
});

test('a page shows a run with files before one that is on the bus alone, and campaigns of both kinds', async () => {
  const { canShow, defaultOf, ofKind } = await load('choice.ts');
  const all = [
    { id: 'far', kind: 'run', folder: null }, { id: 'near', kind: 'run', folder: 'run' },
    { id: 'bus', kind: 'campaign', folder: null, role: null }, { id: 'rollouts', kind: 'dataset', folder: 'r', role: 'rollouts' }, { id: 'data', kind: 'dataset', folder: 'd', role: 'demonstrations' },
  ];
  assert.equal(defaultOf(all, 'run').id, 'near');
  assert.equal(defaultOf(all.slice(0, 1), 'run').id, 'far');
  assert.equal(defaultOf(all, 'campaign').id, 'bus');
  assert.equal(defaultOf(all, 'dataset').id, 'data');
  assert.equal(defaultOf(all, 'eval'), undefined);
  assert.deepEqual(ofKind(all, 'dataset', true).map((one) => one.id), ['rollouts', 'data']);
  assert.deepEqual(['bus', 'data', 'unknown'].map((id) => canShow(all, 'dataset', id)), [false, true, true]);
  assert.ok(canShow(all, 'campaign', 'bus'));
});

test('sources of one name are told apart by their folder', async () => {
  const { labelOf } = await load('choice.ts');
  const all = [{ id: 'x', name: 'run', folder: 'x/run' }, { id: 'y', name: 'run', folder: null }, { id: 'z', name: 'other', folder: 'z' }];
  assert.deepEqual(all.map((one) => labelOf(all, one)), ['run (x/run)', 'run (y)', 'other']);
});

test('a range of an axis is read from the address, or there is none', async () => {
  const { readRange, writeRange, zoomed } = await load('range.ts');
  assert.deepEqual(readRange('100..250'), [100, 250]);
  assert.deepEqual(readRange('-0.5..1e3'), [-0.5, 1000]);
  for (const bad of ['', 'abc', '1', '..', '1..', '..2', '2..1', '3..3', '1..2..3', 'NaN..2', '1..Infinity']) assert.equal(readRange(bad), null, bad);
  // narrower than one unit, it is still a range
  assert.equal(writeRange([100.21, 100.26]), '100.21..100.26');
  assert.equal(writeRange([123.4, 4567.8]), '123..4568');
  assert.deepEqual(zoomed([0, 100], [0, 100], 80, 0.5), [40, 90]);
  assert.deepEqual(zoomed([40, 90], [0, 100], 90, 1.5), [15, 90]);
  assert.deepEqual(zoomed([0, 10], [0, 100], 0, 4), [0, 40]);
  assert.equal(zoomed([40, 90], [0, 100], 80, 2), null);
});

test('keys zoom about a place, and lead out of a range without points', async () => {
  const { zoomedBy } = await load('range.ts');
  const x = [0, 25, 50, 75, 100];
  assert.deepEqual(zoomedBy('+', null, x, 80), [40, 90]);
  assert.deepEqual(zoomedBy('=', [40, 80], x, null), [50, 70]);
  assert.deepEqual(zoomedBy('-', [40, 80], x, null), [20, 100]);
  assert.equal(zoomedBy('-', null, x, 50), null);
  assert.equal(zoomedBy('x', null, x, 50), undefined);
  // fewer than two points: not further in, and out again
  for (const some of [[], [50], x]) {
    assert.equal(zoomedBy('+', [45, 55], some, null), undefined);
    assert.deepEqual(zoomedBy('-', [45, 55], some, null), [40, 60]);
    assert.equal(zoomedBy('0', [45, 55], some, null), null);
  }
  assert.equal(zoomedBy('+', null, [], null), undefined);
});

test('lines over the points of all: no point is none, one that is not finite breaks the line', async () => {
  const { align } = await load('lines.ts');
  const { x, columns } = align([{ x: [1, 2, 3], values: [5, NaN, 7], min: [4, NaN, 6] }, { x: [2, 4], values: [1, 2], base: [10, 10] }]);
  assert.deepEqual([...x], [1, 2, 3, 4]);
  assert.deepEqual(columns[0], [5, null, 7, undefined]);
  assert.deepEqual(columns[1], [4, null, 6, undefined]);
  assert.deepEqual(columns.slice(3), [[undefined, 11, undefined, 12], [undefined, 10, undefined, 10], [undefined, 11, undefined, 12]]);
});

test('arrow keys go to the nearest point that way', async () => {
  const { beside } = await load('beside.ts');
  const [x, y] = [[0, 1, 3, 0.2, -1], [0, 0.5, 0, 2, 0]];
  assert.equal(beside(x, y, 0, [1, 0]), 1);
  assert.equal(beside(x, y, 0, [0, 1]), 3);
  assert.equal(beside(x, y, 0, [-1, 0]), 4);
  assert.equal(beside(x, y, 0, [0, -1]), 0, 'nothing is there');
  assert.equal(beside(x, y, 1, [1, 0]), 2);
});

test('labels of an axis tell its ticks apart and say what they are', async () => {
  const { axisLabels } = await load('format.ts');
  assert.deepEqual(axisLabels([1.25e6, 1.5e6, 1.75e6]), ['1.25M', '1.5M', '1.75M']);
  assert.deepEqual(axisLabels([12050, 12100, 12150]), ['12.05k', '12.1k', '12.15k']);
  assert.deepEqual(axisLabels([0, 4525, 9050]), ['0', '4525', '9050']);
  assert.deepEqual(axisLabels([0.9985, 0.999, 0.9995, 1]), ['0.9985', '0.999', '0.9995', '1']);
  assert.deepEqual(axisLabels([-5, -2.5, 0, 2.5]), ['-5', '-2.5', '0', '2.5']);
  assert.deepEqual(axisLabels([0, 0.00025, 0.0005, 0.00075]), ['0', '2.5e-4', '5e-4', '7.5e-4']);
  assert.deepEqual(axisLabels([0.30000000000000004, 0.4, 0.5]), ['0.3', '0.4', '0.5']);
  assert.deepEqual([axisLabels([]), axisLabels([7])], [[], ['7']]);
  const units = { M: 1e6, k: 1e3 };
  for (const step of [1, 2, 2.5, 5]) {
    for (let power = -7; power < 9; power++) {
      for (const first of [0, 3, 97]) {
        const ticks = [0, 1, 2, 3].map((i) => (first + i) * step * 10 ** power);
        axisLabels(ticks).forEach((label, i) => {
          const value = parseFloat(label) * (units[label.at(-1)] ?? 1);
          assert.ok(Math.abs(value - ticks[i]) < 1e-6 * step * 10 ** power, `${label} for ${ticks[i]}`);
        });
      }
    }
  }
});

test('commands name the absolute folder, quoted where it has to be', async () => {
  const { folderIn } = await load('commands.ts');
  assert.equal(folderIn({ folder: 'out/dataset', path: '/home/a/out/dataset' }, 'DATASET'), '/home/a/out/dataset');
  assert.equal(folderIn({ folder: 'out/dataset' }, 'DATASET'), 'out/dataset');
  assert.equal(folderIn({ folder: null, path: null }, 'DATASET'), 'DATASET');
  assert.equal(folderIn(undefined, 'RUN'), 'RUN');
  assert.equal(folderIn({ path: "/a b/it's" }, 'RUN'), String.raw`'/a b/it'\''s'`);
});

// before, it named no scenes: those of the three tasks on a UR5, whatever had been evaluated
test('the command for a second evaluation names the scenes of the first', async () => {
  const { evaluateInScenesOf } = await load('commands.ts');
  assert.equal(evaluateInScenesOf({ path: '/a b/eval', dataset: 'd1', episodes: 40 }), "etude eval --checkpoint OTHER.safetensors --scenes '/a b/eval'/rollouts --episodes 40 --seed SEED --out eval-b");
  assert.equal(evaluateInScenesOf({ path: '/a/eval', dataset: null, episodes: 40 }), 'etude eval --checkpoint OTHER.safetensors --episodes 40 --seed SEED --out eval-b');
});

test('lines of a log find what the documentation says of them', async () => {
  const { adviceFor, readAdvice } = await load('advice.ts');
  const all = readAdvice(['# Troubleshooting', 'By text.', '## Starting', '### `start \'...\': not found beside this program in`', 'Build `etude`', 'first.', '', '<!-- docs: quick -->', '```bash', 'etude doctor', '```', '', '## Next', 'Not of it.', '### `large blobs`', '(also `bursts are lost ... again`)', 'Do this.', '### `short`', 'No.', ''].join('\n'));
  assert.deepEqual(all.map((one) => one.title), ["start '...': not found beside this program in", 'large blobs']);
  assert.deepEqual(all[0].body, [{ text: 'Build `etude` first.', command: false }, { text: 'etude doctor', command: true }]);
  assert.deepEqual(all[1].body, [{ text: 'Do this.', command: false }]);
  assert.equal(adviceFor("[error] start 'etude-worker': not found beside this program in /usr/bin", all), all[0]);
  assert.equal(adviceFor('not found beside this program in: start \'', all), undefined, 'its parts in their order');
  assert.equal(adviceFor('bursts are lost and sent again', all), all[1]);
  assert.equal(adviceFor('all is well', all), undefined);
  // the page itself: every heading with a text in backquotes is found by that text
  const page = readFileSync(join(web, '../../deploy/docs/troubleshooting.md'), 'utf8');
  const known = readAdvice(page);
  for (const [, key] of page.matchAll(/^### `(.+)`$/gm)) assert.ok(adviceFor(`12:00 ${key.replaceAll('...', 'X')} and so on`, known)?.body.length, key);
});

test('who asks while the gateway cannot answer asks again, and not for ever', async () => {
  const { patiently, RequestError } = await load('api.ts');
  const refused = (status) => { throw new RequestError({ title: 'no', status }); };
  const never = new AbortController().signal;
  let asked = 0;
  assert.equal(await patiently(async () => (++asked < 2 ? refused(503) : 'said'), never), 'said');
  assert.equal(asked, 2);
  await assert.rejects(patiently(async () => refused(503), never, 0), /no/);
  asked = 0;
  await assert.rejects(patiently(async () => { ++asked; return refused(404); }, never), /no/);
  assert.equal(asked, 1, 'another answer counts at once');
  const gone = new AbortController();
  await assert.rejects(patiently(async () => { gone.abort(); return refused(503); }, gone.signal), /no/);
});
