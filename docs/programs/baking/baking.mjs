// Draws a .glb by three.js in a headless Chromium: node baking.mjs FILE.glb WIDTH HEIGHT OUT.f32, in a folder with node_modules.
// OUT: linear radiance as float32 RGBA, bottom row first. A light map in the materials' extras is worn as docs/baking.md has it.
import fs from "fs"; import http from "http"; import path from "path"; import { createRequire } from "module";
const here = path.join(process.cwd(), "node_modules");
const require = createRequire(path.join(here, "x.js"));
const puppeteer = require("puppeteer-core"), validator = require("gltf-validator");
const [file, width, height, out] = process.argv.slice(2);
const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)));
console.log(`gltf-validator: ${report.issues.numErrors} errors, ${report.issues.numWarnings} warnings`);
if (report.issues.numErrors) process.exit(1);
const page = `<!doctype html><link rel="icon" href="data:,"><script type="importmap">
{"imports": {"three": "/three/build/three.module.js", "three/addons/": "/three/examples/jsm/"}}</script><script type="module">
import * as THREE from "three"; import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
window.draw = async (width, height) => {
  const gltf = await new GLTFLoader().loadAsync("/file.glb");
  const found = []; gltf.scene.traverse((o) => o.material && found.push(o.material));
  for (const m of found) { const l = m.userData.lightMap; if (l) {
    m.lightMap = await gltf.parser.assignTexture(m, "lightMap", l, THREE.SRGBColorSpace); m.lightMapIntensity = l.strength; } }
  const renderer = new THREE.WebGLRenderer(), camera = gltf.cameras[0]; renderer.toneMapping = THREE.NoToneMapping;
  camera.aspect = width / height; camera.updateProjectionMatrix();
  const target = new THREE.WebGLRenderTarget(width, height, { type: THREE.FloatType });
  renderer.setRenderTarget(target); renderer.setClearColor(0, 0); renderer.render(gltf.scene, camera);
  const data = new Float32Array(4 * width * height); renderer.readRenderTargetPixels(target, 0, 0, width, height, data);
  const bytes = new Uint8Array(data.buffer); let text = "";
  for (let i = 0; i < bytes.length; i += 32768) text += String.fromCharCode(...bytes.subarray(i, i + 32768));
  return btoa(text);
};
</script>`;
const server = http.createServer((asked, answer) => {
  const name = asked.url === "/file.glb" ? file : path.join(here, path.normalize(asked.url));
  if (asked.url === "/") return answer.setHeader("content-type", "text/html").end(page);
  if (!fs.existsSync(name)) return answer.writeHead(404).end();
  answer.setHeader("content-type", name.endsWith(".js") ? "text/javascript" : "application/octet-stream").end(fs.readFileSync(name));
}).listen(0);
const executablePath = process.env.CHROMIUM || "/usr/bin/chromium";
const args = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"];
const browser = await puppeteer.launch({ executablePath, args });
try {
  const tab = await browser.newPage(); tab.on("pageerror", (e) => console.log("page:", e.message));
  await tab.goto(`http://localhost:${server.address().port}/`);
  await tab.waitForFunction("window.draw");
  fs.writeFileSync(out, Buffer.from(await tab.evaluate((w, h) => window.draw(w, h), +width, +height), "base64"));
} finally { await browser.close(); server.close(); }
