// SPDX-License-Identifier: Apache-2.0
import type { ComponentType } from 'preact';
import { useEffect, useState } from 'preact/hooks';

/** A page whose script is loaded when somebody goes there, once. */
export function lazily(load: () => Promise<ComponentType>): ComponentType {
  let loaded: ComponentType | null = null;
  return function Lazy() {
    const [View, show] = useState<ComponentType | null>(() => loaded);
    const [failed, fail] = useState(false);
    useEffect(() => {
      if (loaded) return;
      load().then((view) => {
        loaded = view;
        show(() => view);
      }, () => fail(true));
    }, []);
    if (View) return <View />;
    return <p role="status" {...(failed ? {} : { 'data-loading': '' })}>{failed ? 'This page is of another version of the gateway: reload it.' : 'loading'}</p>;
  };
}
