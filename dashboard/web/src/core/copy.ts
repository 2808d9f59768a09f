// SPDX-License-Identifier: Apache-2.0
// To the clipboard, which browsers give to pages of this machine and of https alone.

/** False where the browser refuses; then whoever reads it has to copy it. `beside`: what an open dialog leaves alive. */
export async function copyText(text: string, beside: HTMLElement): Promise<boolean> {
  const clipboard: Clipboard | undefined = navigator.clipboard;
  if (clipboard) {
    try {
      await clipboard.writeText(text);
      return true;
    } catch { /* not allowed: as without one */ }
  }
  const before = document.activeElement;
  const field = document.createElement('textarea');
  field.value = text;
  field.className = 'sr';
  field.tabIndex = -1;
  beside.append(field);
  field.select();
  const done = document.execCommand('copy');
  field.remove();
  if (before instanceof HTMLElement) before.focus();
  return done;
}

/** As if somebody had drawn over it with the mouse. */
export function selectAll(of: HTMLElement): void {
  window.getSelection()?.selectAllChildren(of);
}
