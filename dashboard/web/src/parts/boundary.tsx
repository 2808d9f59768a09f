// SPDX-License-Identifier: Apache-2.0
// What a page that cannot be drawn leaves: its error in words, with all else of the window around it.
import { Component, type ComponentChildren } from 'preact';
import { Failed } from './basics';

interface Props { of: string; children: ComponentChildren }

/** `of`: what is drawn; another one is tried anew. */
export class Boundary extends Component<Props, { error: unknown; of: string }> {
  override state = { error: undefined as unknown, of: this.props.of };

  static override getDerivedStateFromProps(props: Props, state: { error: unknown; of: string }) {
    return props.of === state.of ? null : { error: undefined, of: props.of };
  }

  override componentDidCatch(error: unknown) {
    console.warn('this page could not be drawn:', error);
    this.setState({ error });
  }

  override render() {
    if (this.state.error === undefined) return this.props.children;
    return (
      <div data-broken>
        <Failed problem={{ title: 'This page cannot be drawn', status: 0, detail: String(this.state.error), hint: 'The gateway may be of another version than this page: load the page again. If that does not help, it is a fault of the dashboard.' }} retry={() => this.setState({ error: undefined })} />
      </div>
    );
  }
}
