// SPDX-License-Identifier: Apache-2.0
// deploy/docs/troubleshooting.md by the texts that it is keyed with: what to do about a line of a log.

export interface Advice {
  /** Parts of a text in their order; what stands between them differs from case to case. */
  texts: string[][];
  title: string;
  /** Paragraphs, and commands to copy. */
  body: { text: string; command: boolean }[];
}

const codes = /`([^`]+)`/g;

function textsOf(line: string): string[][] {
  return [...line.matchAll(codes)].map(([, code]) => code!.split('...').map((part) => part.trim()).filter(Boolean)).filter((parts) => parts.join('').length >= 8);
}

function bodyOf(lines: string[]): Advice['body'] {
  const body: Advice['body'] = [];
  let text: string[] = [];
  let fenced = false;
  const flush = () => {
    if (text.length) body.push({ text: text.join(fenced ? '\n' : ' '), command: fenced });
    text = [];
  };
  for (const line of lines) {
    if (line.startsWith('```')) {
      flush();
      fenced = !fenced;
    } else if (fenced) text.push(line);
    else if (!line.trim() || line.startsWith('<!--')) flush();
    else text.push(line.trim());
  }
  flush();
  return body;
}

/** A heading `### ` with a text in backquotes; lines "(also `...`)" below it have more of them. */
export function readAdvice(markdown: string): Advice[] {
  return markdown.split(/^### /m).slice(1).flatMap((section) => {
    const [head = '', ...rest] = section.split(/^## /m)[0]!.split('\n');
    const also = rest.filter((line) => line.startsWith('(also '));
    const texts = [head, ...also].flatMap(textsOf);
    const title = head.replaceAll('`', '');
    return texts.length ? [{ texts, title, body: bodyOf(rest.filter((line) => !also.includes(line))) }] : [];
  });
}

/** What is known of this line. */
export function adviceFor(line: string, all: readonly Advice[]): Advice | undefined {
  const has = (parts: string[]) => {
    let from = 0;
    return parts.every((part) => {
      const at = line.indexOf(part, from);
      from = at + part.length;
      return at >= 0;
    });
  };
  return all.find((one) => one.texts.some(has));
}
