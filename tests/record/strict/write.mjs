// Writes messages, which come as JSON, with the writer that Foxglove uses: node write.mjs PACKAGES < JSON > MCAP
import { createRequire } from "node:module";
import { readFileSync, writeSync } from "node:fs";
import { pathToFileURL } from "node:url";

const require = createRequire(pathToFileURL(`${process.argv[2]}/package.json`));
const { McapWriter } = require("@mcap/core");
const { topics, messages, useChunks } = JSON.parse(readFileSync(0, "utf8"));
let position = 0n;
const writable = {
  position: () => position,
  write: async (bytes) => {
    for (let at = 0; at < bytes.length; ) at += writeSync(1, bytes, at);
    position += BigInt(bytes.length);
  },
};
const writer = new McapWriter({ writable, useChunks, chunkSize: 2000 });
await writer.start({ profile: "", library: "@mcap/core" });
const channels = [];
for (const { topic, encoding, schema, schemaEncoding, text } of topics) {
  const data = new TextEncoder().encode(text);
  const schemaId = schema === "" ? 0 : await writer.registerSchema({ name: schema, encoding: schemaEncoding, data });
  const metadata = new Map();
  channels.push(await writer.registerChannel({ topic, messageEncoding: encoding, schemaId, metadata }));
}
for (const [channel, time, sequence, data] of messages) {
  await writer.addMessage({
    channelId: channels[channel],
    sequence,
    logTime: BigInt(time),
    publishTime: BigInt(time),
    data: Buffer.from(data, "base64"),
  });
}
await writer.end();
