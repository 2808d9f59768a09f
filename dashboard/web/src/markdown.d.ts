// SPDX-License-Identifier: Apache-2.0
// Pages of the documentation, as the bundler gives them.
declare module '*.md' {
  const text: string;
  export default text;
}
