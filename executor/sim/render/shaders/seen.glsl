// From a mesh to the picture: where a vertex is, and how its surface is turned, in the world.

#include "./sets.glsl"
#include "./wall.glsl"

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec3 tangent;
layout(location = 4) in vec3 bitangent;

layout(location = 0) out vec4 outPlace;
layout(location = 1) out vec3 outNormal;
layout(location = 2) out vec2 outUV;
layout(location = 3) out flat uint outBody;
layout(location = 4) out flat vec4 outTint;  // The vertex's own colour; 0 where it has none.

void main() {
  mat4 T_world_body = objectTransformBuffer.modelMatrix;
  vec4 place = T_world_body * vec4(position, 1);
  vec4 seen = cameraBuffer.viewMatrix * place;
  gl_Position = cameraBuffer.projectionMatrix * seen;
  // A wall is not drawn for an eye behind it: its x axis looks into the room.
  vec3 toEye = cameraBuffer.viewMatrixInverse[3].xyz - T_world_body[3].xyz;
  if (isWall(uv) && dot(T_world_body[0].xyz, toEye) < 0.0) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  outPlace = vec4(place.xyz, -seen.z);
  // Bodies are turned and stretched, never sheared: dividing by the squared stretch is the inverse's transpose.
  mat3 turn = mat3(T_world_body);
  outNormal = turn * (normal / vec3(dot(turn[0], turn[0]), dot(turn[1], turn[1]), dot(turn[2], turn[2])));
  outUV = uv;
  // A number below -1 is no place in a texture but a colour: red and green as its digits to the base of 4096, then blue.
  float code = -1.0 - uv.x, red = floor(code / 4096.0);
  outTint = uv.x < -0.5 ? vec4(red, code - 4096.0 * red, mod(uv.y, 4096.0), 4095.0) / 4095.0 : vec4(0.0);
  outBody = objectDataBuffer.segmentation.y;
}
