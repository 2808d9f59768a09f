// SPDX-License-Identifier: Apache-2.0
// What a page that cannot be drawn leaves: its error in words, with all else of the window around it.
import { Component, type ComponentChildren } from 'preact';
import { epoch } from '../core/connection';
import { Failed } from './basics';

interface Props { of: string; children: ComponentChildren }

// before it is tried again by itself, ms
const [firstPause, longestPause] = [4000, 60000];

/** `of`: what is drawn; another one is tried anew, and so is this one after a while: one bad message is no end. */
export class Boundary extends Component<Props, { error: unknown; of: string }> {
  override state = { error: undefined as unknown, of: this.props.of };
  private pause = firstPause;
  private tried = 0;
  private timer = 0;
  private forget = () => {};

  static override getDerivedStateFromProps(props: Props, state: { error: unknown; of: string }) {
    return props.of === state.of ? null : { error: undefined, of: props.of };
  }

  override componentDidMount() {
    this.forget = epoch.subscribe(() => this.again());
  }

  override componentWillUnmount() {
    this.forget();
    window.clearTimeout(this.timer);
  }

  override componentDidCatch(error: unknown) {
    console.error('this page could not be drawn:', error);
    // what stood for a while broke by something new
    this.pause = Date.now() - this.tried < this.pause ? Math.min(longestPause, 2 * this.pause) : firstPause;
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.again(), this.pause);
    this.setState({ error });
  }

  again() {
    window.clearTimeout(this.timer);
    if (this.state.error === undefined) return;
    this.tried = Date.now();
    this.setState({ error: undefined });
  }

  override render() {
    if (this.state.error === undefined) return this.props.children;
    return (
      <div data-broken>
        <Failed problem={{ title: 'This page cannot be drawn', status: 0, detail: String(this.state.error), hint: 'It is tried again by itself. The gateway may be of another version than this page: load the page again. If that does not help, it is a fault of the dashboard.' }} retry={() => this.again()} />
      </div>
    );
  }
}
