#version 450
#extension GL_GOOGLE_include_directive : enable
#include "./wall.glsl"
// From a mesh to the map of what a lamp sees.

layout(set = 0, binding = 0) uniform LightBuffer {
  mat4 viewMatrix;
  mat4 viewMatrixInverse;
  mat4 projectionMatrix;
  mat4 projectionMatrixInverse;
  int width;
  int height;
} lightBuffer;

layout(set = 1, binding = 0) uniform ObjectTransformBuffer { mat4 modelMatrix; } objectTransformBuffer;

layout(set = 1, binding = 1) uniform ObjectDataBuffer {
  uvec4 segmentation;
  float transparency;
  int shadeFlat;
} objectDataBuffer;

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec3 tangent;
layout(location = 4) in vec3 bitangent;

void main() {
  vec4 place = objectTransformBuffer.modelMatrix * vec4(position, 1);
  gl_Position = lightBuffer.projectionMatrix * (lightBuffer.viewMatrix * place);
  if (isWall(uv)) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);  // Walls let the sun in.
}
