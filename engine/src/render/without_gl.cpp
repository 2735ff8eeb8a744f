// GlRenderer of a build with FLOCKSTEP_GL=OFF, for systems without EGL: it is never available, so raycast renders.
#include "render/gl/renderer.hpp"

namespace flockstep::render {

struct GlRenderer::Impl {};

GlRenderer::GlRenderer(std::chrono::milliseconds) { throw GlUnavailable("this build of flockstep has no backend gl"); }
GlRenderer::~GlRenderer() = default;
std::string GlRenderer::description() const { return {}; }
void GlRenderer::start(std::span<const RenderRequest>) {}
void GlRenderer::finish(Workers&) {}

}  // namespace flockstep::render
