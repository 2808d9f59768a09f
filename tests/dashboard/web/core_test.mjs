// SPDX-License-Identifier: Apache-2.0
// What the pages compute themselves: intervals, formats, safetensors. Needs no browser and no gateway.
import assert from 'node:assert/strict';
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

test('numbers as pages write them', async () => {
  const { age, bytes, duration, number, percent, probability } = await load('format.ts');
  assert.deepEqual([number(0.15321), number(6589), number(0), number(null), number(4.8e-9)], ['0.153', '6,589', '0', '–', '4.8e-9']);
  assert.deepEqual([percent(1), percent(0.9875), percent(null)], ['100 %', '98.8 %', '–']);
  assert.deepEqual([duration(588), duration(3725), duration(null)], ['9:48', '1:02:05', '–']);
  assert.deepEqual([age(300), age(14000), age(240000)], ['0.3 s', '14 s', '4 min']);
  assert.deepEqual([bytes(999), bytes(4680000)], ['999 B', '4.68 MB']);
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

test('a tie is rounded to the even digit, as the programs do', async () => {
  const { percent, rounded } = await load('format.ts');
  assert.equal(percent(385 / 400), '96.2 %');
  assert.equal(percent(0.96375), '96.4 %');
  assert.equal(rounded(0.75, 1), '0.8');
  assert.equal(percent(1), '100 %');
});
