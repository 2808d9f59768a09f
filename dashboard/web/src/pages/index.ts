// SPDX-License-Identifier: Apache-2.0
// The pages, in the order of the rail, with the key that goes to each.
import type { ComponentType } from 'preact';
import type { Kind } from '../core/choice';
import { lazily } from '../parts/lazy';
import { Overview } from './overview';
import { Fleet } from './fleet';
import { Generation } from './generation';
import { DatasetPage } from './dataset';
import { Training } from './training';
import { Evaluation } from './evaluation';

export interface Page {
  path: string;
  title: string;
  key: string;
  icon: string;
  group: string;
  /** Kinds of source that it shows, for the picker. */
  sources: readonly Kind[];
  view: ComponentType;
  /** Reached from others only. */
  hidden?: boolean;
}

export const pages: readonly Page[] = [
  { path: '', title: 'Overview', key: 'o', group: '', icon: 'M2 8l6-5 6 5M4 7v6h8V7', sources: [], view: Overview },
  { path: 'fleet', title: 'Fleet', key: 'f', group: 'Generate', icon: 'M2 3h12v4H2zM2 9h12v4H2zM4.5 5h.01M4.5 11h.01', sources: [], view: Fleet },
  { path: 'generation', title: 'Generation', key: 'n', group: 'Generate', icon: 'M3 13V8M8 13V3M13 13v-3', sources: ['campaign'], view: Generation },
  { path: 'dataset', title: 'Dataset', key: 'd', group: 'Generate', icon: 'M2 3h12v10H2zM2 6.5h12M2 9.5h12M6 3v10', sources: ['dataset'], view: DatasetPage },
  { path: 'episode', title: 'Episode', key: '', group: '', icon: '', sources: [], view: lazily(() => import('./episode').then((page) => page.EpisodePage)), hidden: true },
  { path: 'training', title: 'Training', key: 't', group: 'Learn', icon: 'M2 3v10h12M4 5c2 5 5 6 9 6', sources: ['run'], view: Training },
  { path: 'inside', title: 'Inside', key: 'i', group: 'Learn', icon: 'M3 4h3v3H3zM3 10h3v3H3zM10 7h3v3h-3zM6 5.5h2l2 3M6 11.5h2l2-3', sources: ['run'], view: lazily(() => import('./inside').then((page) => page.Inside)) },
  { path: 'checkpoints', title: 'Checkpoints', key: 'c', group: 'Learn', icon: 'M4 14V2h7l-2 3 2 3H4', sources: ['run'], view: lazily(() => import('./checkpoints').then((page) => page.CheckpointsPage)) },
  { path: 'evaluation', title: 'Evaluation', key: 'e', group: 'Judge', icon: 'M2 8.5l3.5 4L14 4', sources: ['eval'], view: Evaluation },
  { path: 'topics', title: 'Topics', key: 'k', group: 'System', icon: 'M3 8h3M10 8h3M8 3v3M8 10v3M6 6h4v4H6z', sources: [], view: lazily(() => import('./topics').then((page) => page.TopicsPage)) },
  { path: 'play', title: 'Play', key: 'y', group: 'Judge', icon: 'M4 2.5v11l9-5.5z', sources: [], view: lazily(() => import('./play').then((page) => page.PlayPage)) },
  { path: 'logs', title: 'Logs', key: 'l', group: 'System', icon: 'M3 3h10M3 6.5h7M3 10h10M3 13.5h5', sources: [], view: lazily(() => import('./logs').then((page) => page.LogsPage)) },
];
