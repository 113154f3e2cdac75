// What the scripts of the page add to the browser's own types.

interface Window {
  rigdTheme: { readonly chosen: string; choose(theme: string): void };
}

/** What an element may contain. */
type Child = Node | string | number | null | undefined | readonly Child[];

/** Properties, attributes and listeners of an element that is made. */
type Props = { [name: string]: unknown } & {
  [K in keyof GlobalEventHandlersEventMap as `on${K}`]?: (event: GlobalEventHandlersEventMap[K]) => unknown;
};
