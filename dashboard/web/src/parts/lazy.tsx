// SPDX-License-Identifier: Apache-2.0
import type { ComponentType } from 'preact';
import { useEffect, useState } from 'preact/hooks';
import { epoch } from '../core/connection';

/** A page whose script is loaded when somebody goes there, once. */
export function lazily(load: () => Promise<ComponentType>): ComponentType {
  let loaded: ComponentType | null = null;
  return function Lazy() {
    const [View, show] = useState<ComponentType | null>(() => loaded);
    const [failed, fail] = useState(false);
    const generation = epoch.value;
    useEffect(() => {
      if (loaded) return;
      load().then((view) => {
        loaded = view;
        show(() => view);
      }, () => fail(true));
    }, [generation]);  // a gateway that was away may have it now
    if (View) return <View />;
    return <p role="status" {...(failed ? {} : { 'data-loading': '' })}>{failed ? 'The script of this page did not come: reload it.' : 'loading'}</p>;
  };
}
