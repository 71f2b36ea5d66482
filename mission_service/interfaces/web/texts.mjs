// Lists the texts of the page's sources, for tests/web/test_texts.py: `node texts.mjs` prints the keys of
// messages (the first argument of t), and texts that are not translated, as JSON.

import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { parseSync } from "rolldown/utils";

const FOLDER = fileURLToPath(new URL("src", import.meta.url));
const PAGES = ["index.html", "incident.html"].map((name) => fileURLToPath(new URL(name, import.meta.url)));
const SHOWN = ["title", "aria-label", "placeholder", "alt", "label"]; // attributes with texts for users
// Functions with arguments that are names in the code, not texts.
const TECHNICAL = new Set([
  "querySelector", "querySelectorAll", "matchMedia", "closest", "matches", "getContext", "addEventListener", "on",
  "once", "getLayer", "getSource", "addSource", "addLayer", "setPaintProperty", "setLayoutProperty", "getItem",
  "setItem", "removeItem", "includes", "startsWith", "endsWith", "fillLayer", "lineLayer", "circleLayer", "colour",
  "info", "warn", "error", "Error", "DOMException", "Path2D", "URL", "namedFlavor", "toLocaleString", "CSS", "RegExp", "toggle",
  "Intl", "DateTimeFormat", "NumberFormat", "replace", "replaceAll", "Headers", "labelLayer", "iconLayer", "byId", "part",
  "shape", "join", "split", "add", "remove", "parseFromString", "createElement",
]);
const FIRST_TECHNICAL = new Set(["h", "shortcut", "word", "post", "get", "ask", "download", "request"]);
const PROSE = /[A-Za-zα]{2,}[^A-Za-z]* [^A-Za-z]*[A-Za-z]|^[A-Z][a-z]+|^[A-Z-]{3,}$/; // words, a capital letter, or capitals
// Names of layers, addresses, keys, kinds and media queries.
const NAMES = /^(image \{\} \{\}|on board|POST|PATCH|PUT|MapLibre|ArduPilot|VTOL|(Ctrl|Alt|Shift)\+|Space|relieves \{\}|area \{\}|\{\} \(Alt\+\{\}\)|English|Español|Português|\(width .*|button, a, .*|input, select, .*)$/;
const COLOURS = /^(#[0-9a-f]+|bold \d+px .*|\d+px .*)$/i;

/** The name of the function that a call calls. */
const calleeOf = ({ callee }) => callee?.property?.name ?? callee?.name ?? "";
const textOf = (node) => (node.type === "TemplateLiteral" ? node.quasis.map((each) => each.value.cooked).join("{}") : node.value);

/** Whether a string is shown to users, as far as its place in the source shows it. */
function isText(node, parents) {
  const text = textOf(node);
  let [child, sure] = [node, false];
  for (const parent of parents.toReversed()) {
    if (/^(Import|Export(All|Named))|^TS(?!As|NonNull|Satisfies)/.test(parent.type)) return false;
    if (parent.type === "Property" && parent.key === child) return false;
    if (parent.type === "MemberExpression" && parent.property === child) return false;
    if (parent.type === "BinaryExpression" && parent.operator !== "+") return false;
    if (parent.type === "SwitchCase" && parent.test === child) return false;
    if (parent.type === "AssignmentExpression" && child === parent.right) {
      const name = parent.left.property?.name ?? "";
      if (["title", "textContent"].includes(name)) sure = true;
      else if (parent.left.type === "MemberExpression") return false;
    }
    if (parent.type === "Property") {
      const name = parent.key.name ?? parent.key.value;
      if (["class", "id", "type", "role", "for", "name", "key", "Authorization", "filter", "paint", "layout", "font"].includes(name)) return false;
      if (SHOWN.includes(name)) sure = true;
    }
    if (parent.type === "CallExpression" || parent.type === "NewExpression") {
      const name = calleeOf(parent);
      const place = parent.arguments.indexOf(child);
      if (name === "t" && place === 0) return false;
      if (name === "t") break; // a value of a message
      if (TECHNICAL.has(name) && place >= 0) return false;
      if (FIRST_TECHNICAL.has(name) && place === 0) return false;
      if (name === "h" && place === 1 && !sure) return false; // attributes
      if ((name === "h" && place > 1 && child === node) || (name === "setText" && place === 1)) sure = true;
      break;
    }
    if (/^(Arrow)?Function|Declaration$|Statement$|Definition$/.test(parent.type) && parent.type !== "ReturnStatement" && parent.type !== "ArrowFunctionExpression") break;
    child = parent;
  }
  if (COLOURS.test(text) || NAMES.test(text)) return false;
  if (node.type === "TemplateLiteral") {
    const words = node.quasis.map((each) => each.value.cooked);
    return words.some((each) => /[A-Za-z]{2,}/.test(each)) && (sure || words.some((each) => /\s/.test(each)));
  }
  return sure ? /[A-Za-z]{2,}/.test(text) : PROSE.test(text);
}

/** Call `found` for each string and template, with its parents. */
export function visit(node, found, parents = []) {
  if (!node || typeof node !== "object") return;
  if (Array.isArray(node)) return node.forEach((each) => visit(each, found, parents));
  if (typeof node.type !== "string") return;
  const isString = (node.type === "Literal" && typeof node.value === "string") || node.type === "TemplateLiteral";
  if (isString && found(node, parents) === false) return;
  for (const value of Object.values(node)) if (value && typeof value === "object") visit(value, found, [...parents, node]);
}

export const parsed = (name, source) => parseSync(name, source).program;
export { isText, textOf };

/** The keys and the texts without translation of a source file. */
function textsOf(name, source) {
  const [keys, untranslated] = [[], []];
  visit(parsed(name, source), (node, parents) => {
    const parent = parents.at(-1);
    const isKey = parent?.type === "CallExpression" && calleeOf(parent) === "t" && parent.arguments[0] === node;
    if (isKey) keys.push(textOf(node));
    else if (isText(node, parents)) {
      untranslated.push(`${name}:${source.slice(0, node.start).split("\n").length}: ${textOf(node)}`);
    }
  });
  return { keys, untranslated };
}

if (process.argv[1] === fileURLToPath(import.meta.url)) {
  const names = readdirSync(FOLDER, { recursive: true }).filter((name) => name.endsWith(".ts")).sort();
  const all = names.map((name) => textsOf(name, readFileSync(join(FOLDER, name), "utf-8")));
  const pages = PAGES.map((name) => readFileSync(name, "utf-8")).join("");
  const labels = [...pages.matchAll(/aria-label="([^"]*)"/g)].map(([, label]) => label);
  const keys = [...new Set([...labels, ...all.flatMap(({ keys }) => keys)])];
  console.log(JSON.stringify({ keys, untranslated: all.flatMap(({ untranslated }) => untranslated) }));
}
