import { BrowserHome, type EditorApi, EditorHome, type Home } from "./home";
import { SiteHome } from "./site/home";

declare const acquireVsCodeApi: undefined | (() => EditorApi);

/** Return the home of this page: that of VS Code, of a site of static files, or of `btcore studio`. */
export function findHome(): Home {
  if (typeof acquireVsCodeApi === "function") return new EditorHome(acquireVsCodeApi());
  return document.querySelector("script[data-home=site]") ? new SiteHome() : new BrowserHome();
}
