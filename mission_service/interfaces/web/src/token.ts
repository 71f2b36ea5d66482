// The token: from `#token=…` into this tab's storage, and out of the address bar.

const KEY = "mission-service-token";

/** Take the token out of the address, where there is one. */
export function takeToken(): void {
  const found = /[#&]token=([^&]+)/.exec(location.hash);
  if (found?.[1]) {
    sessionStorage.setItem(KEY, decodeURIComponent(found[1]));
    history.replaceState(null, "", location.pathname + location.search);
  }
}

export const token = (): string => sessionStorage.getItem(KEY) ?? "";
export const keepToken = (value: string): void => sessionStorage.setItem(KEY, value.trim());
export const forgetToken = (): void => sessionStorage.removeItem(KEY);
