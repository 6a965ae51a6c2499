// What the Khronos glTF validator finds: glb.js VALIDATOR FILE..., the folder of its package first.
//
// Prints one line of JSON: per file the numbers of errors and warnings, and its messages of both kinds.

const fs = require("fs");

const [, , place, ...files] = process.argv;
const validator = require(place);
const SERIOUS = 1; // 0 is an error, 1 a warning, 2 a remark.

async function told(file) {
  const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)));
  const { numErrors, numWarnings, messages } = report.issues;
  return {
    errors: numErrors,
    warnings: numWarnings,
    messages: messages.filter((m) => m.severity <= SERIOUS).slice(0, 3),
  };
}

Promise.all(files.map(told)).then(
  (answers) => console.log(JSON.stringify(answers)),
  (error) => {
    console.error(String(error));
    process.exit(1);
  },
);
