// SPDX-License-Identifier: Apache-2.0
import './style/tokens.css';
import 'uplot/dist/uPlot.min.css';
import './style/base.css';
import { render } from 'preact';
import * as connection from './core/connection';
import * as keys from './core/keys';
import * as router from './core/router';
import * as theme from './core/theme';
import { Boundary } from './parts/boundary';
import { Shell } from './shell';

theme.start();
router.start();
keys.start();
connection.start();
render(<Boundary of=""><Shell /></Boundary>, document.getElementById('app')!);
