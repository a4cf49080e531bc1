// Reads a report as OHIF does: dcmjs and Cornerstone's adapters, from the folder given first. Prints what came out.
import { createRequire } from 'node:module';
import { readFileSync } from 'node:fs';
import { pathToFileURL } from 'node:url';
import path from 'node:path';

const [folder, file] = process.argv.slice(2);
const require = createRequire(pathToFileURL(path.join(folder, 'x.mjs')));
const from = name => import(pathToFileURL(require.resolve(name)).href);
const dcmjs = await from('dcmjs').then(found => found.default ?? found);
const entry = path.join(folder, 'node_modules/@cornerstonejs/adapters/dist/esm/index.js');
const { adaptersSR } = await import(pathToFileURL(entry).href);

const bytes = readFileSync(file);
const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
const message = dcmjs.data.DicomMessage.readFile(buffer);
const dataset = dcmjs.data.DicomMetaDictionary.naturalizeDataset(message.dict);
dataset._meta = dcmjs.data.DicomMetaDictionary.namifyDataset(message.meta);

// OHIF's own handler asks for these without looking whether they are there.
const meaning = item => [].concat(item.ConceptNameCodeSequence ?? [])[0]?.CodeMeaning;
const content = [].concat(dataset.ContentSequence);
const library = content.find(item => meaning(item) === 'Image Library');
const images = [].concat([].concat(library.ContentSequence)[0].ContentSequence)
    .filter(item => item.ValueType === 'IMAGE').length;

const metadata = { get: () => undefined };
const state = adaptersSR.Cornerstone3D.MeasurementReport.generateToolState(dataset, {}, metadata);
const measurements = [];
for (const [tool, found] of Object.entries(state)) {
    for (const { description, finding, annotation, TrackingUniqueIdentifier } of found) {
        measurements.push({
            tool, description, code: finding?.CodeValue, uid: TrackingUniqueIdentifier,
            label: annotation.data.label ?? null,
            points: annotation.data.handles.points ?? [],
            contour: annotation.data.contour ?? null,
            frame: annotation.metadata.FrameOfReferenceUID,
        });
    }
}
console.log(JSON.stringify({ images, series: dataset.SeriesDescription, measurements },
    (_, value) => (ArrayBuffer.isView(value) ? [...value] : value)));
