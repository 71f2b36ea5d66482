// The pre-flight checks of the chosen vehicle on the ground, and the sign-off of its takeoff.

import { attempt, lacking } from "../actions.ts";
import { post } from "../api.ts";
import { fill, h, setReason, setText } from "../dom.ts";
import { t } from "../messages.ts";
import type { Store } from "../store.ts";
import type { Check, Vehicle } from "../types.ts";
import { button, section } from "./parts.ts";

const MARKS: Record<Check["state"], string> = { fail: `✗ ${t("fails")}`, unknown: `? ${t("unknown")}`, pass: `✓ ${t("passes")}` };

export class PreflightPart {
  readonly element: HTMLElement;
  private checks = h("ul", { class: "preflight", "aria-label": t("Pre-flight checks") });
  private passing = h("ul", { class: "preflight" });
  private count = h("summary");
  private rest = h("details", {}, this.count, this.passing);
  private state = h("p");
  private reason = h("input", { type: "text", maxlength: 200, id: "override", autocomplete: "off" });
  private override = h("label", { for: "override" }, t("Reason to override the failing checks"), this.reason);
  private takeoff = button(t("Sign off and take off"), () => this.signOff());
  private shown = "";
  private vehicle = "";

  constructor(private readonly store: Store) {
    this.takeoff.classList.add("takeoff");
    this.reason.addEventListener("input", () => this.renew());
    const parts = [this.checks, this.rest, this.state, this.override, h("div", { class: "row orders" }, this.takeoff)];
    this.element = section(t("Pre-flight checks"), ...parts);
    store.on(["vehicle", "chosen"], () => this.renew());
    this.renew();
  }

  private async signOff(): Promise<void> {
    const { chosen } = this.store;
    const path = `vehicles/${encodeURIComponent(chosen)}/takeoff`;
    const failing = failingChecks(this.store.vehicles.get(chosen));
    const override = failing.length ? this.reason.value.trim() : "";
    if (await attempt(t("Takeoff {vehicle}", { vehicle: chosen }), () => post(path, { override }))) this.reason.value = "";
    this.renew();
  }

  private renew(): void {
    const vehicle = this.store.vehicles.get(this.store.chosen);
    this.element.hidden = !vehicle?.checks.length;
    if (!vehicle || this.element.hidden) return;
    if (this.vehicle !== vehicle.vehicle) this.reason.value = ""; // a reason concerns one vehicle
    this.vehicle = vehicle.vehicle;
    const key = JSON.stringify(vehicle.checks);
    if (key !== this.shown) this.list(vehicle.checks);
    this.shown = key;
    const failing = failingChecks(vehicle);
    setText(this.state, stateText(vehicle));
    this.override.hidden = !failing.length;
    const reasonLacks = failing.length && !this.reason.value.trim() ? t("A check fails: give the reason to override it") : "";
    setReason(this.takeoff, lacking(this.store, "fly") || reasonLacks);
    setText(this.takeoff, failing.length ? t("Override and take off") : t("Sign off and take off"));
  }

  private list(checks: Check[]): void {
    const of = (state: Check["state"]): HTMLElement[] => checks.filter((check) => check.state === state).map(row);
    const passing = of("pass");
    fill(this.checks, ...of("fail"), ...of("unknown"));
    fill(this.passing, ...passing);
    setText(this.count, t("{count} of {all} checks pass", { count: passing.length, all: checks.length }));
    this.rest.hidden = !passing.length;
  }
}

export function failingChecks(vehicle: Vehicle | undefined): Check[] {
  return (vehicle?.checks ?? []).filter((check) => check.state === "fail");
}

function stateText(vehicle: Vehicle): string {
  if (vehicle.signed_off_by) return t("Takeoff signed off by {name}.", { name: vehicle.signed_off_by });
  return vehicle.waits_for_signoff ? t("Takes off only after a sign-off.") : t("The scenario starts it without a sign-off.");
}

function row(check: Check): HTMLElement {
  const mark = h("span", { class: "mark" }, MARKS[check.state]);
  return h("li", { class: check.state }, mark, h("strong", {}, check.name), ` ${check.text}`);
}
