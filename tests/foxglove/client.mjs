// Foxglove's own client flies the lab's four checkpoints, and prints what it found as one JSON line.
// node client.mjs ws://127.0.0.1:8765/?token=..
import { createRequire } from "node:module";

const require = createRequire(`${process.cwd()}/`);
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const WebSocket = require("ws");

const address = process.argv[2];
const text = new TextEncoder();
const plain = (data) => JSON.parse(new TextDecoder().decode(data));

const socket = new WebSocket(address, ["foxglove.sdk.v1", FoxgloveClient.SUPPORTED_SUBPROTOCOL]);
const client = new FoxgloveClient({ ws: socket });
const channels = new Map();
const services = new Map();
const topics = new Map();
const last = new Map();
const answers = new Map();
const parameters = new Map();
const problems = [];
let calls = 0;

client.on("advertise", (found) => {
  for (const each of found) channels.set(each.topic, each);
});
client.on("advertiseServices", (found) => {
  for (const each of found) services.set(each.name, each);
});
client.on("message", ({ subscriptionId, data }) => last.set(topics.get(subscriptionId), plain(data)));
client.on("serviceCallResponse", ({ callId, data }) => answers.set(callId, plain(data)));
client.on("serviceCallFailure", ({ callId, message }) => answers.set(callId, { failure: message }));
client.on("status", ({ message }) => problems.push(message));
client.on("parameterValues", ({ parameters: values, id }) => parameters.set(id, values));
client.on("error", (error) => {
  console.error(error);
  process.exit(1);
});

async function until(condition) {
  const deadline = Date.now() + 20_000;
  for (;;) {
    const found = condition();
    if (found) return found;
    if (Date.now() > deadline) throw new Error(`never: ${condition}`);
    await new Promise((resolve) => setTimeout(resolve, 10));
  }
}

async function call(name, request) {
  const callId = ++calls;
  const { id } = services.get(name);
  const data = new DataView(text.encode(JSON.stringify(request)).buffer);
  client.sendServiceCallRequest({ serviceId: id, callId, encoding: "json", data });
  return until(() => answers.get(callId));
}

async function values(send, id) {
  send(id);
  return Object.fromEntries((await until(() => parameters.get(id))).map((p) => [p.name, p.value]));
}

await until(() => services.has("uav/goto") && channels.has("uav/pose"));
for (const topic of ["uav/pose", "uav/safety/state", "/scene"]) {
  topics.set(client.subscribe(channels.get(topic).id), topic);
}
await until(() => last.has("uav/pose") && last.has("uav/safety/state") && last.has("/scene"));
const near = (x, y, z) => {
  const p = last.get("uav/pose").position;
  return Math.hypot(p.x - x, p.y - y, p.z - z) < 0.1;
};
const found = { protocol: socket.protocol };
found.calibrated = await call("uav/calibrate_pressure", { zero: true });
found.cage = await call("uav/toggle_cage", { cage_on: true });
found.inside = await call("uav/goto", { x: 1, y: 2, z: 1.5 });
if (found.inside.accepted) {
  await until(() => near(1, 2, 1.5) && last.get("uav/safety/state").state === "HOVERING");
}
found.outside = await call("uav/goto", { x: 9, y: 0, z: 1 });
const goals = client.advertise({ topic: "/goto", encoding: "json", schemaName: "" });
client.sendMessage(goals, text.encode('{"x": 0, "y": 0, "z": 1}'));
if (found.inside.accepted) await until(() => near(0, 0, 1));
const name = "uav.safety.acceptance_range";
found.read = await values((id) => client.getParameters([name], id), "read");
found.set = await values((id) => client.setParameters([{ name, value: 0.375 }], id), "set");
found.problems = problems;
console.log(JSON.stringify(found));
client.close();
