export {
  AmbientLight, ArrowHelper, BufferAttribute, BufferGeometry, CanvasTexture, Color, CylinderGeometry, DirectionalLight, DoubleSide,
  Group, HemisphereLight, Line, LineBasicMaterial, LineDashedMaterial, LineSegments, Mesh, MeshBasicMaterial, MeshLambertMaterial,
  PerspectiveCamera, Quaternion, Scene, SphereGeometry, Sprite, SpriteMaterial, Vector3, WebGLRenderer, TubeGeometry,
  CatmullRomCurve3, Matrix4, LatheGeometry, Vector2,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
