// Modules of a local file cannot import each other: give each a blob URL, and map their names.
const imports = {};
for (const { dataset, textContent } of document.querySelectorAll('script[type="text/umo-module"]')) {
  const source = `${textContent}\n//# sourceURL=umo/${dataset.name}`;
  imports[`umo/${dataset.name}`] = URL.createObjectURL(new Blob([source], { type: "text/javascript" }));
}
const map = document.createElement("script");
map.type = "importmap";
map.textContent = JSON.stringify({ imports });
document.head.append(map);
import(document.documentElement.dataset.main).catch((error) => {
  const notice = document.querySelector("#notice");
  notice.textContent = `This page cannot start: ${error.message}`;
  notice.dataset.kind = "error";
  throw error;
});
