/** Checks a value by the part of JSON Schema that pydantic writes for our messages. */

import { SCHEMA } from "./protocol.gen.ts";

export type Side = "FromPage" | "FromServer";

interface Node {
  $ref?: string;
  const?: unknown;
  enum?: unknown[];
  anyOf?: Node[];
  oneOf?: Node[];
  discriminator?: { mapping: Record<string, string>; propertyName: string };
  type?: string;
  properties?: Record<string, Node>;
  required?: string[];
  additionalProperties?: boolean | Node;
  items?: Node;
  prefixItems?: Node[];
  minItems?: number;
  maxItems?: number;
  maxLength?: number;
  minimum?: number;
  maximum?: number;
  exclusiveMinimum?: number;
  exclusiveMaximum?: number;
}

const DEFINITIONS = SCHEMA.$defs as unknown as Record<string, Node>;

/** Why `value` is no message of this side; empty if it is one. */
export function whyNot(side: Side, value: unknown): string {
  return check(DEFINITIONS[side]!, value, "");
}

function check(node: Node, value: unknown, at: string): string {
  if (node.$ref !== undefined) return check(resolve(node.$ref), value, at);
  if (node.discriminator !== undefined) return checkKind(node.discriminator, value, at);
  if (node.const !== undefined) return value === node.const ? "" : `${at}: not ${String(node.const)}`;
  if (node.enum !== undefined) return node.enum.includes(value) ? "" : `${at}: not one of its values`;
  const options = node.anyOf ?? node.oneOf;
  if (options !== undefined) {
    const reasons = options.map((option) => check(option, value, at));
    return reasons.includes("") ? "" : (reasons[0] ?? "");
  }
  switch (node.type) {
    case "object":
      return checkObject(node, value, at);
    case "array":
      return checkArray(node, value, at);
    case "string":
      if (typeof value !== "string") return `${at}: no text`;
      return [...value].length > (node.maxLength ?? Infinity) ? `${at}: too long` : "";
    case "integer":
      return Number.isInteger(value) ? checkRange(node, value as number, at) : `${at}: no whole number`;
    case "number":
      return Number.isFinite(value) ? checkRange(node, value as number, at) : `${at}: no number`;
    case "boolean":
      return typeof value === "boolean" ? "" : `${at}: neither true nor false`;
    case "null":
      return value === null ? "" : `${at}: not null`;
    default:
      return `${at}: of a type this page does not know`;
  }
}

function resolve(reference: string): Node {
  return DEFINITIONS[reference.slice(reference.lastIndexOf("/") + 1)]!;
}

function checkKind(by: NonNullable<Node["discriminator"]>, value: unknown, at: string): string {
  if (!isObject(value)) return `${at}: no object`;
  const reference = by.mapping[String(value[by.propertyName])];
  return reference === undefined ? `${at}.${by.propertyName}: unknown` : check(resolve(reference), value, at);
}

function checkObject(node: Node, value: unknown, at: string): string {
  if (!isObject(value)) return `${at}: no object`;
  for (const name of node.required ?? []) if (!(name in value)) return `${at}.${name}: missing`;
  for (const [name, child] of Object.entries(value)) {
    const known = node.properties?.[name] ?? node.additionalProperties;
    if (known === undefined || known === false) return `${at}.${name}: unknown`;
    const reason = known === true ? "" : check(known, child, `${at}.${name}`);
    if (reason) return reason;
  }
  return "";
}

function checkArray(node: Node, value: unknown, at: string): string {
  if (!Array.isArray(value)) return `${at}: no list`;
  if (value.length < (node.minItems ?? 0) || value.length > (node.maxItems ?? Infinity)) return `${at}: wrong length`;
  for (const [index, child] of value.entries()) {
    const known = node.prefixItems?.[index] ?? node.items;
    const reason = known === undefined ? "" : check(known, child, `${at}[${index}]`);
    if (reason) return reason;
  }
  return "";
}

function checkRange(node: Node, value: number, at: string): string {
  const inside =
    value >= (node.minimum ?? -Infinity) &&
    value <= (node.maximum ?? Infinity) &&
    value > (node.exclusiveMinimum ?? -Infinity) &&
    value < (node.exclusiveMaximum ?? Infinity);
  return inside ? "" : `${at}: out of bounds`;
}

function isObject(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}
