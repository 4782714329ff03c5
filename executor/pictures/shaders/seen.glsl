// From a mesh to the picture: where a vertex is, and how its surface is turned, in the world.

#include "./sets.glsl"

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec3 tangent;
layout(location = 4) in vec3 bitangent;

layout(location = 0) out vec4 outPlace;
layout(location = 1) out vec3 outNormal;
layout(location = 2) out vec2 outUV;
layout(location = 3) out flat uint outBody;

void main() {
  mat4 T_world_body = objectTransformBuffer.modelMatrix;
  vec4 place = T_world_body * vec4(position, 1);
  vec4 seen = cameraBuffer.viewMatrix * place;
  gl_Position = cameraBuffer.projectionMatrix * seen;
  outPlace = vec4(place.xyz, -seen.z);
  // Bodies are turned and stretched, never sheared: dividing by the squared stretch is the inverse's transpose.
  mat3 turn = mat3(T_world_body);
  outNormal = turn * (normal / vec3(dot(turn[0], turn[0]), dot(turn[1], turn[1]), dot(turn[2], turn[2])));
  outUV = uv;
  outBody = objectDataBuffer.segmentation.y;
}
