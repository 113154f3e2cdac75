// Reads one MCAP file with @mcap/core (the reader of Foxglove) both ways, stream and indexed, and
// audits what neither checks: every offset and length in every index, and the data section's CRC.
// Prints {topic: {count, sha256}} where the hash is over log time and payload, in time order.
// Exit code 1 and a message on stderr at the first thing that is wrong.
//
//     node check.mjs PACKAGES FILE      PACKAGES: the folder that has node_modules
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const [packages, path] = process.argv.slice(2);
const require = createRequire(pathToFileURL(`${packages}/package.json`));
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const { crc32 } = require("@foxglove/crc");
const { loadDecompressHandlers } = require("@mcap/support");

const MAGIC = "894d434150300d0a";
const OP = { chunk: 6, message: 5, messageIndex: 7, attachment: 9, metadata: 12, dataEnd: 15 };
const FRAME = 9;

function demand(condition, text) {
  if (!condition) throw new Error(text);
}

// Yields {opcode, start, end, content} from a buffer; refuses a record that runs out of it.
function* frames(bytes, at, until) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  while (at < until) {
    demand(at + FRAME <= until, `record at ${at} has no room for its frame`);
    const opcode = view.getUint8(at);
    const end = at + FRAME + Number(view.getBigUint64(at + 1, true));
    demand(end <= until, `record ${opcode} at ${at} runs to ${end}, over ${until}`);
    yield { opcode, start: at, end, content: bytes.subarray(at + FRAME, end) };
    at = end;
  }
}

const viewOf = (bytes) => new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);

function parseMessageIndex(content) {
  const view = viewOf(content);
  const size = view.getUint32(2, true);
  demand(size === content.length - 6 && size % 16 === 0, "size of a message index");
  const entries = [];
  for (let at = 6; at < content.length; at += 16) {
    entries.push([view.getBigUint64(at, true), Number(view.getBigUint64(at + 8, true))]);
  }
  return { channel: view.getUint16(0, true), entries };
}

// Reads the whole file as a stream; returns its chunks (with data) and messages.
function readStream(bytes, decompressHandlers) {
  const reader = new McapStreamReader({ includeChunks: true, decompressHandlers });
  reader.append(bytes);
  const found = { Chunk: [], Message: [], Attachment: [], Metadata: [], Schema: [], Channel: [] };
  let ended = false;
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "DataEnd") ended = true;
    demand(record.type !== "Unknown", `unknown record ${record.opcode}`);
    if (!ended && record.type in found) {
      found[record.type].push(record.data ? { ...record, data: record.data.slice() } : record);
    }
  }
  demand(reader.done() && reader.bytesRemaining() === 0, "the stream reader is not done");
  return found;
}

// Checks one chunk index against the bytes that it points to.
function auditChunk(bytes, byStart, index, decompressHandlers) {
  const start = Number(index.chunkStartOffset);
  const record = byStart.get(start);
  demand(record?.opcode === OP.chunk, `chunk index points to ${start}, where no chunk begins`);
  demand(record.end - start === Number(index.chunkLength), `length of chunk at ${start}`);
  const view = viewOf(record.content);
  demand(view.getBigUint64(0, true) === index.messageStartTime, "start time of a chunk");
  demand(view.getBigUint64(8, true) === index.messageEndTime, "end time of a chunk");
  demand(view.getBigUint64(16, true) === index.uncompressedSize, "size of a chunk");
  const nameLength = view.getUint32(28, true);
  const packed = record.content.subarray(32 + nameLength + 8);
  const name = Buffer.from(record.content.subarray(32, 32 + nameLength)).toString();
  demand(name === index.compression, "compression of a chunk");
  demand(BigInt(packed.length) === index.compressedSize, "compressed size of a chunk");
  demand(view.getBigUint64(32 + nameLength, true) === index.compressedSize, "packed size");
  const data = name ? decompressHandlers[name](packed, index.uncompressedSize).slice() : packed;
  demand(BigInt(data.length) === index.uncompressedSize, "uncompressed size of a chunk");
  demand(view.getUint32(24, true) === crc32(data), `CRC of the chunk at ${start}`);

  const messages = new Map([...frames(data, 0, data.length)].map((one) => [one.start, one]));
  const times = [...messages.values()].map((one) => viewOf(one.content).getBigUint64(6, true));
  const sorted = [...times].sort((a, b) => (a < b ? -1 : a > b ? 1 : 0));
  demand(sorted[0] === index.messageStartTime, "first time in a chunk");
  demand(sorted.at(-1) === index.messageEndTime, "last time in a chunk");
  let indexLength = 0;
  for (const [channel, offset] of index.messageIndexOffsets) {
    const place = byStart.get(Number(offset));
    demand(place?.opcode === OP.messageIndex, `message index of channel ${channel} at ${offset}`);
    demand(place.start >= record.end, "a message index before its chunk");
    indexLength += place.end - place.start;
    const { channel: named, entries } = parseMessageIndex(place.content);
    demand(named === channel, "channel of a message index");
    for (const [time, at] of entries) {
      const message = messages.get(at);
      demand(message?.opcode === OP.message, `no message at ${at} of the chunk at ${start}`);
      const head = viewOf(message.content);
      demand(head.getUint16(0, true) === channel, "channel of an indexed message");
      demand(head.getBigUint64(6, true) === time, "time of an indexed message");
      messages.delete(at);
    }
  }
  demand(messages.size === 0, `${messages.size} messages of a chunk are in no index`);
  demand(BigInt(indexLength) === index.messageIndexLength, "length of the message indexes");
}

function auditSummary(bytes, reader) {
  const opcodes = new Map();
  const { summaryStart, summaryOffsetStart } = reader.footer;
  for (const record of frames(bytes, Number(summaryStart), Number(summaryOffsetStart))) {
    const group = opcodes.get(record.opcode);
    demand(!group || group.end === record.start, `group ${record.opcode} is in two parts`);
    opcodes.set(record.opcode, { start: group?.start ?? record.start, end: record.end });
  }
  demand(reader.summaryOffsetsByOpcode.size === opcodes.size, "number of summary offsets");
  for (const [opcode, { groupStart, groupLength }] of reader.summaryOffsetsByOpcode) {
    const group = opcodes.get(opcode);
    demand(group && BigInt(group.start) === groupStart, `summary offset of group ${opcode}`);
    demand(BigInt(group.end - group.start) === groupLength, `length of group ${opcode}`);
  }
}

function auditStatistics(statistics, found, reader) {
  const said = [
    [statistics.messageCount, BigInt(found.Message.length), "messages"],
    [statistics.chunkCount, found.Chunk.length, "chunks"],
    [statistics.attachmentCount, found.Attachment.length, "attachments"],
    [statistics.metadataCount, found.Metadata.length, "metadata"],
    [statistics.schemaCount, reader.schemasById.size, "schemas"],
    [statistics.channelCount, reader.channelsById.size, "channels"],
    [reader.chunkIndexes.length, found.Chunk.length, "chunk indexes"],
    [reader.attachmentIndexes.length, found.Attachment.length, "attachment indexes"],
    [reader.metadataIndexes.length, found.Metadata.length, "metadata indexes"],
    [found.Schema.length, reader.schemasById.size, "schemas in the data"],
    [found.Channel.length, reader.channelsById.size, "channels in the data"],
  ];
  for (const [stated, actual, what] of said) {
    demand(stated === actual, `${what}: the summary says ${stated}, the file has ${actual}`);
  }
  for (const [channel, count] of statistics.channelMessageCounts) {
    const actual = found.Message.filter((message) => message.channelId === channel).length;
    demand(BigInt(actual) === count, `channel ${channel}: ${count} stated, ${actual} there`);
  }
}

function digest(messages, channelsById) {
  const topics = {};
  const hashes = new Map();
  for (const { channelId, logTime, publishTime, data } of messages) {
    demand(logTime === publishTime, "log time and publish time differ");
    const { topic } = channelsById.get(channelId);
    if (!hashes.has(topic)) hashes.set(topic, { count: 0, hash: createHash("sha256") });
    const entry = hashes.get(topic);
    const time = Buffer.alloc(8);
    time.writeBigUInt64LE(logTime);
    entry.hash.update(time).update(data);
    entry.count += 1;
  }
  for (const [topic, { count, hash }] of hashes) topics[topic] = { count, sha256: hash.digest("hex") };
  return topics;
}

async function main() {
  const decompressHandlers = await loadDecompressHandlers();
  const bytes = new Uint8Array(readFileSync(path));
  demand(Buffer.from(bytes.subarray(0, 8)).toString("hex") === MAGIC, "magic at the start");
  const readable = {
    size: async () => BigInt(bytes.length),
    read: async (offset, size) => bytes.slice(Number(offset), Number(offset + size)),
  };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const found = readStream(bytes, decompressHandlers);

  const dataEnd = Number(reader.dataEndOffset);
  demand(reader.dataSectionCrc !== 0, "the data section has no CRC");
  demand(reader.dataSectionCrc === crc32(bytes.subarray(0, dataEnd)), "CRC of the data section");
  demand(reader.footer.summaryCrc !== 0, "the summary has no CRC");
  const byStart = new Map([...frames(bytes, 8, dataEnd)].map((one) => [one.start, one]));
  for (const index of reader.chunkIndexes) auditChunk(bytes, byStart, index, decompressHandlers);
  for (const [indexes, opcode] of [
    [reader.attachmentIndexes, OP.attachment],
    [reader.metadataIndexes, OP.metadata],
  ]) {
    for (const { offset, length, name } of indexes) {
      const record = byStart.get(Number(offset));
      demand(record?.opcode === opcode, `index of ${name} points to ${offset}`);
      demand(BigInt(record.end - record.start) === length, `length of ${name}`);
    }
  }
  auditSummary(bytes, reader);
  auditStatistics(reader.statistics, found, reader);

  const indexed = [];
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    indexed.push({ ...message, data: message.data.slice() });
  }
  for await (const attachment of reader.readAttachments({ validateCrcs: true })) {
    demand(attachment.name, "an attachment without a name");
  }
  const topics = digest(indexed, reader.channelsById);
  const byTime = found.Message.sort((a, b) => (a.logTime < b.logTime ? -1 : a.logTime > b.logTime ? 1 : 0));
  const streamed = digest(byTime, reader.channelsById);
  for (const topic of Object.keys(topics)) {
    demand(streamed[topic]?.sha256 === topics[topic].sha256, `${topic} differs between the readers`);
  }
  console.log(JSON.stringify(topics));
}

main().catch((error) => {
  console.error(`${path}: ${error.message}`);
  process.exit(1);
});
