// The token: moved from `#token=…` in the address to the storage of this tab.

const KEY = "mission-service-token";

/** Store the token in the address, if it has one, and remove it from the address bar. */
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
