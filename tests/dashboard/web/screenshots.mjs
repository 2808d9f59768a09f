// SPDX-License-Identifier: Apache-2.0
// Pictures of every page, and what axe and the console say of it.
//   node screenshots.mjs http://127.0.0.1:8080 OUT [page,page] [width,width] [theme,theme]   of a gateway that runs
//   node screenshots.mjs --start OUT DIR...                                                 of one started over DIR...
import { mkdirSync } from 'node:fs';
import { join, resolve } from 'node:path';
import { addresses, axe, launch, openPage, overflow, themes, visit, widths } from './browser.mjs';
import { startGateway } from './gateway.mjs';

const [first, out, ...rest] = process.argv.slice(2);
const gateway = first === '--start' ? await startGateway(rest.map((one) => resolve(one))) : null;
const base = gateway?.address ?? first;
const [only, wide, which] = gateway ? [] : rest;
if (!out) {
  console.error('screenshots: node screenshots.mjs ADDRESS OUT [pages] [widths] [themes]');
  process.exit(2);
}
mkdirSync(out, { recursive: true });
const browser = await launch();
let failed = false;
for (const [name, address] of Object.entries(await addresses(base))) {
  if (only && !only.split(',').includes(name)) continue;
  for (const width of wide ? wide.split(',').map(Number) : widths) {
    for (const theme of which ? which.split(',') : themes) {
      const { page, context, wrong } = await openPage(browser, base, { width, theme, height: width < 640 ? 780 : width > 2000 ? 1300 : 860 });
      try {
        await visit(page, base + address);
        // charts load when they come into view
        await page.evaluate(async () => { for (let y = 0; y < document.body.scrollHeight; y += 700) { window.scrollTo(0, y); await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))); } window.scrollTo(0, 0); });
        await page.waitForLoadState('networkidle').catch(() => undefined);
        await page.screenshot({ path: join(out, `${name}-${width}-${theme}.png`), fullPage: true });
        for (const line of [...wrong, ...(await axe(page)), ...(await overflow(page)).map((one) => `wider than the window: ${one}`)]) {
          failed = true;
          console.log(`${name} ${width} ${theme}: ${line}`);
        }
      } catch (error) {
        failed = true;
        console.log(`${name} ${width} ${theme}: ${error.message.split('\n')[0]}`, wrong);
      }
      await context.close();
    }
  }
}
await browser.close();
await gateway?.stop();
process.exit(failed ? 1 : 0);
