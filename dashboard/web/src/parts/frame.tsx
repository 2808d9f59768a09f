// SPDX-License-Identifier: Apache-2.0
// A scene's picture, as often as the link brings one: a newer address would break off the load of the one before.
import { useEffect, useRef, useState } from 'preact/hooks';

/** `n`: the newest there is; `address` of one. */
export function Frame(props: { n: number; address: (n: number) => string; width?: number; height?: number }) {
  const [asked, ask] = useState(props.n);
  const newest = useRef(props.n);
  newest.current = props.n;
  const loading = useRef(true);
  const follow = () => {
    loading.current = newest.current !== asked;
    if (loading.current) ask(newest.current);
  };
  useEffect(() => { if (!loading.current) follow(); }, [props.n]);
  return <img src={props.address(asked)} width={props.width} height={props.height} alt="What the robot's camera sees" data-frame={asked} onLoad={follow} onError={follow} />;
}
