// SPDX-License-Identifier: Apache-2.0
// In place of what is in the files of a run, where this gateway has none of them.
import { link } from '../core/router';
import { nameOf } from '../core/sources';
import { elsewhere, Empty, Panel } from './basics';

export function Elsewhere(props: { of: string }) {
  return (
    <Panel><div data-elsewhere><Empty title={`${nameOf(props.of)} is on the bus only`} command="etude dashboard --dir FOLDER">
      {elsewhere('run')} How far it is stands in <a href={link('training', { run: props.of })}>Training</a>; its files are shown by a gateway on the machine that has them:
    </Empty></div></Panel>
  );
}
