// What a surface looks like: matt and shiny light of each lamp, the first one's past what stands in its way.

layout(constant_id = 0) const int NUM_DIRECTIONAL_LIGHTS = 3;
layout(constant_id = 1) const int NUM_DIRECTIONAL_LIGHT_SHADOWS = 1;

#include "./sets.glsl"

layout(set = 2, binding = 0) uniform MaterialBuffer {
  vec4 emission;
  vec4 baseColor;
  float fresnel;
  float roughness;
  float metallic;
  float transmission;
  float ior;
  float transmissionRoughness;
  int textureMask;
  int padding1;
  vec4 textureTransforms[6];
} materialBuffer;
layout(set = 2, binding = 1) uniform sampler2D colorTexture;
layout(set = 2, binding = 2) uniform sampler2D roughnessTexture;
layout(set = 2, binding = 3) uniform sampler2D normalTexture;
layout(set = 2, binding = 4) uniform sampler2D metallicTexture;
layout(set = 2, binding = 5) uniform sampler2D emissionTexture;
layout(set = 2, binding = 6) uniform sampler2D transmissionTexture;

layout(set = 3, binding = 0) uniform SceneBuffer {
  vec4 ambientLight;
  DirectionalLight directionalLights[3];
  SpotLight spotLights[10];
  PointLight pointLights[10];
  SpotLight texturedLights[1];
} sceneBuffer;
layout(set = 3, binding = 1) uniform ShadowBuffer {
  LightBuffer directionalLightBuffers[1];
  LightBuffer spotLightBuffers[10];
  LightBuffer pointLightBuffers[18];
  LightBuffer texturedLightBuffers[1];
} shadowBuffer;
layout(set = 3, binding = 2) uniform samplerCube samplerPointLightDepths[3];
layout(set = 3, binding = 3) uniform sampler2D samplerDirectionalLightDepths[1];
layout(set = 3, binding = 4) uniform sampler2D samplerTexturedLightDepths[1];
layout(set = 3, binding = 5) uniform sampler2D samplerSpotLightDepths[10];
layout(set = 3, binding = 6) uniform sampler2D samplerTexturedLightTextures[1];

layout(location = 0) in vec4 inPlace;
layout(location = 1) in vec3 inNormal;
layout(location = 2) in vec2 inUV;
layout(location = 3) in flat uint inBody;
layout(location = 4) in flat vec4 inTint;

layout(location = 0) out vec4 outColor;
layout(location = 1) out ivec4 outPositionSegmentation;  // Depth in mm third, the body fourth.

const float PI = 3.14159265;

// The share of a lamp's light that arrives: sixteen texels around the place, weighed so that edges are soft.
float arriving(int lamp) {
  LightBuffer from = shadowBuffer.directionalLightBuffers[lamp];
  vec4 at = from.projectionMatrix * (from.viewMatrix * vec4(inPlace.xyz, 1));
  vec2 place = at.xy * 0.5 + 0.5;
  float size = textureSize(samplerDirectionalLightDepths[lamp], 0).x;
  vec2 part = fract(place * size - 0.5);
  float free = 0.0;
  for (int k = 0; k < 4; ++k) {
    vec2 beside = vec2((k & 1) * 2 - 1, (k >> 1) * 2 - 1) / size;
    vec4 open = step(vec4(at.z), textureGather(samplerDirectionalLightDepths[lamp], place + beside));
    free += mix(mix(open.w, open.z, part.x), mix(open.x, open.y, part.x), part.y);
  }
  return 0.25 * free;
}

void main() {
  vec4 base = materialBuffer.baseColor;
  if ((materialBuffer.textureMask & 1) != 0) base = texture(colorTexture, inUV);
  else if (inTint.w > 0.0) base = inTint;
  vec3 toEye = normalize(cameraBuffer.viewMatrixInverse[3].xyz - inPlace.xyz);
  vec3 normal = normalize(inNormal);
  normal = dot(normal, toEye) < 0.0 ? -normal : normal;
  // Blinn and Phong's highlight, as wide as Trowbridge and Reitz's of this roughness.
  float alpha = max(materialBuffer.roughness * materialBuffer.roughness, 0.02);
  float power = 2.0 / (alpha * alpha) - 2.0;
  vec3 mirror = mix(vec3(materialBuffer.fresnel * 0.08), base.rgb, materialBuffer.metallic);
  vec3 matt = base.rgb * (1.0 - materialBuffer.metallic);
  vec3 color = base.rgb * (sceneBuffer.ambientLight.rgb + materialBuffer.emission.rgb);
  for (int k = 0; k < NUM_DIRECTIONAL_LIGHTS; ++k) {
    vec3 toLamp = -sceneBuffer.directionalLights[k].direction.xyz;
    float upright = max(dot(normal, toLamp), 0.0);
    if (k < NUM_DIRECTIONAL_LIGHT_SHADOWS) upright *= arriving(0);
    float along = max(dot(normal, normalize(toLamp + toEye)), 0.0);
    vec3 shine = mirror * ((power + 2.0) / 8.0 * pow(along, power));
    color += upright * sceneBuffer.directionalLights[k].emission.rgb * (matt + shine) / PI;
  }
  outColor = vec4(pow(color, vec3(1.0 / 2.2)), base.a * (1.0 - objectDataBuffer.transparency));
  outPositionSegmentation = ivec4(0, 0, int(inPlace.w * 1000.0 + 0.5), int(inBody));
}
