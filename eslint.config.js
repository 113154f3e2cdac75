import js from "@eslint/js";

export default [
  {
    files: ["rigd/panel/static/js/**/*.js"],
    ...js.configs.recommended,
    linterOptions: { reportUnusedDisableDirectives: "error" },
    rules: {
      ...js.configs.recommended.rules,
      "no-undef": "off", // tsc knows what a browser has
      "no-control-regex": "off", // control characters are what dom.js looks for
      "no-empty": ["error", { allowEmptyCatch: false }],
      "eqeqeq": "error",
      "no-var": "error",
      "prefer-const": "error",
      "no-shadow": "error",
      "no-implicit-coercion": "error",
      "no-param-reassign": "error",
      "no-unused-expressions": ["error", { allowShortCircuit: true, allowTernary: true }],
    },
  },
  { files: ["rigd/panel/static/js/theme.js"], languageOptions: { sourceType: "script" } },
];
