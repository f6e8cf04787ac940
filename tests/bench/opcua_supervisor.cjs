/* Runs parts as a line's supervisor does, by node-opcua's client over the encrypted endpoint.

    NODE_PATH=FOLDER/node_modules node opcua_supervisor.cjs PORT RECIPE PARTS FOLDER

Ends when the run has ended; PARTS of 0 aborts a part instead.
Certificates are kept in the folder. Writes `document.json` there: {browsed: [path], results: [{name: value}], states: [name]}. */

const fs = require("node:fs");
const opcua = require("node-opcua-client");
const { OPCUACertificateManager } = require("node-opcua-certificate-manager");

const NAMESPACE = "http://opcfoundation.org/UA/MachineVision";
const MACHINE = "VisionStateMachine";
const AUTOMATIC = `${MACHINE}/AutomaticModeStateMachine`;
const STATES = [`${MACHINE}/CurrentState`, `${AUTOMATIC}/CurrentState`];
const OBJECTS = "i=85";
const NAMESPACES = "i=2255";

const pause = () => new Promise((resolve) => setTimeout(resolve, 10));

/* A session by the names of the address space. */
class Supervisor {
  constructor(session) {
    this.session = session;
    this.nodes = new Map();
    this.states = new Set();
  }

  async read(nodeId) {
    const answer = await this.session.read({ nodeId, attributeId: opcua.AttributeIds.Value });
    return answer.value.value;
  }

  async children(nodeId) {
    const answer = await this.session.browse({
      nodeId, referenceTypeId: "HierarchicalReferences", includeSubtypes: true, resultMask: 63,
    });
    return answer.references;
  }

  /* Finds all nodes below one, by their path of browse names. */
  async browse(nodeId, path = "") {
    for (const { browseName, nodeId: below } of await this.children(nodeId)) {
      const at = path ? `${path}/${browseName.name}` : browseName.name;
      if (this.nodes.has(at)) continue;
      this.nodes.set(at, below);
      await this.browse(below, at);
    }
  }

  async value(path) {
    const value = await this.read(this.nodes.get(path));
    return value instanceof opcua.LocalizedText ? value.text : value;
  }

  /* Waits until a variable has a value, 30 s at most. */
  async until(path, wanted) {
    for (let tries = 0; tries < 3000; tries += 1) {
      if (await this.value(path) === wanted) return;
      await pause();
    }
    throw new Error(`${path} is ${await this.value(path)}, not ${wanted}`);
  }

  /* Calls a method; returns its outputs by name. */
  async call(path, dataType, value) {
    const methodId = this.nodes.get(path);
    const objectId = this.nodes.get(path.slice(0, path.lastIndexOf("/")));
    const inputArguments = value === undefined ? [] : [{ dataType, value }];
    const answer = await this.session.call({ objectId, methodId, inputArguments });
    if (!answer.statusCode.isGood()) throw new Error(`${path}: ${answer.statusCode}`);
    const names = await this.read(this.nodes.get(`${path}/OutputArguments`));
    const outputs = names.map((each, at) => [each.name, answer.outputArguments[at].value]);
    const { error, message, ...rest } = Object.fromEntries(outputs);
    if (error) throw new Error(`${path}: ${error} ${message}`);
    return rest;
  }

  /* Notes every state that a machine enters from now on. */
  async follow() {
    const subscription = await this.session.createSubscription2({
      requestedPublishingInterval: 20, requestedLifetimeCount: 1000, requestedMaxKeepAliveCount: 10,
      maxNotificationsPerPublish: 0, publishingEnabled: true, priority: 1,
    });
    for (const path of STATES) {
      const item = await subscription.monitor(
        { nodeId: this.nodes.get(path), attributeId: opcua.AttributeIds.Value },
        { samplingInterval: 0, queueSize: 1000, discardOldest: false },
        opcua.TimestampsToReturn.Neither,
      );
      item.on("changed", (data) => this.states.add(data.value.value.text));
    }
  }

  async start(measId) {
    return (await this.call(`${AUTOMATIC}/StartSingleJob`, "String", measId)).jobId;
  }

  async result(job) {
    await this.until("ResultManagement/ResultReady", true);
    const result = await this.call("ResultManagement/GetResultById", "String", job);
    await this.call("ResultManagement/ReleaseResultHandle", "UInt32", result.ResultHandle);
    return result;
  }
}

async function main(port, recipe, parts, folder) {
  const client = opcua.OPCUAClient.create({
    applicationUri: "urn:line:supervisor",
    clientCertificateManager: new OPCUACertificateManager({
      rootFolder: folder, automaticallyAcceptUnknownCertificate: true,
    }),
    securityMode: opcua.MessageSecurityMode.SignAndEncrypt,
    securityPolicy: opcua.SecurityPolicy.Basic256Sha256,
    connectionStrategy: { maxRetry: 60, initialDelay: 100, maxDelay: 500 },
    endpointMustExist: false,
  });
  await client.connect(`opc.tcp://127.0.0.1:${port}`);
  const line = new Supervisor(await client.createSession());
  const index = Array.from(await line.read(NAMESPACES)).indexOf(NAMESPACE);
  const systems = await line.children(OBJECTS);
  await line.browse(systems.find((each) => each.browseName.namespaceIndex === index).nodeId);
  await line.follow();
  await line.until(`${MACHINE}/CurrentState`, "Preoperational");
  await line.call(`${MACHINE}/SelectModeAutomatic`);
  await line.call("RecipeManagement/PrepareRecipe", "String", recipe);
  const results = [];
  for (let number = 0; number < parts; number += 1) {
    results.push(await line.result(await line.start(String(number))));
  }
  if (parts === 0) {
    await line.start("aborted");
    await line.call(`${AUTOMATIC}/Abort`);
  }
  const end = parts === 0 ? "Error" : "Halted";
  for (let tries = 0; tries < 3000 && !line.states.has(end); tries += 1) await pause();
  const states = [...line.states].filter((state) => state);
  const document = { browsed: [...line.nodes.keys()], results, states };
  await client.disconnect();
  fs.writeFileSync(`${folder}/document.json`, JSON.stringify(document));
}

const [port, recipe, parts, folder] = process.argv.slice(2);
main(port, recipe, Number(parts), folder).catch((error) => {
  console.error(error);
  process.exit(1);
});
