// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/renderer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "services/core/check.h"
#include "worker/assets/shifted_world.h"
#include "worker/sim/gl_context.h"
#include "worker/sim/model.h"

namespace etude::sim {
namespace {

/// Room for what is drawn besides the model's geoms: MuJoCo leaves out what does not fit, without a word.
constexpr int kBesidesGeoms = 100;

/// MuJoCo's GL resources: textures, meshes, an off-screen framebuffer of a fixed size.
class RenderContext {
 public:
  RenderContext(const mjModel* model, int width, int height, int samples) {
    // the size is read from the model, which is shared and constant: a copy for the call
    ModelPtr sized(mj_copyModel(nullptr, model));
    sized->vis.global.offwidth = width;
    sized->vis.global.offheight = height;
    sized->vis.quality.offsamples = samples;
    mjr_defaultContext(&con_);
    mjr_makeContext(sized.get(), &con_, mjFONTSCALE_100);
    mjr_setBuffer(mjFB_OFFSCREEN, &con_);
  }
  ~RenderContext() { mjr_freeContext(&con_); }
  RenderContext(const RenderContext&) = delete;
  RenderContext& operator=(const RenderContext&) = delete;

  const mjrContext* get() const { return &con_; }
  bool offscreen() const { return con_.currentBuffer == mjFB_OFFSCREEN; }
  void Use() { mjr_setBuffer(mjFB_OFFSCREEN, &con_); }
  /// Fills a texture of `model` with one colour, 0..1, or with its own pixels. Nothing happens when it is so already.
  void Paint(const mjModel& model, int texture, const std::optional<Eigen::Vector3d>& colour);

 private:
  mjrContext con_;
  std::optional<Eigen::Vector3d> painted_;
};

void RenderContext::Paint(const mjModel& model, int texture, const std::optional<Eigen::Vector3d>& colour) {
  if (colour == painted_) return;
  painted_ = colour;
  if (!colour) return mjr_uploadTexture(&model, &con_, texture);
  const auto pixels = static_cast<std::size_t>(model.tex_width[texture]) * model.tex_height[texture];
  std::vector<mjtByte> rgb;
  for (std::size_t i = 0; i < pixels; ++i)
    for (const double channel : *colour)
      rgb.push_back(static_cast<mjtByte>(std::lround(255 * std::clamp(channel, 0.0, 1.0))));
  // the model is shared and constant: another view of it, with pixels of our own
  mjModel view = model;
  std::vector<int> begins(static_cast<std::size_t>(model.ntex), 0);
  view.tex_adr = begins.data();
  view.tex_rgb = rgb.data();
  mjr_uploadTexture(&view, &con_, texture);
}

/// Its number, -1 when the model has none of this name.
int TextureOf(const mjModel& model, const std::string& name) { return mj_name2id(&model, mjOBJ_TEXTURE, name.c_str()); }

/// GL's first row is the bottom one.
template <class T>
void FlipRows(T* pixels, std::size_t row_size, int height) {
  for (int y = 0; y < height / 2; ++y) {
    T* const upper = pixels + static_cast<std::size_t>(y) * row_size;
    std::swap_ranges(upper, upper + row_size, pixels + static_cast<std::size_t>(height - 1 - y) * row_size);
  }
}

/// Points both eyes of `camera` as `view` says; MuJoCo draws the mean of the two.
void Aim(mjvScene& scene, const Camera& view) {
  const Eigen::Matrix3d R = view.X_WC.q.toRotationMatrix();
  for (mjvGLCamera& eye : scene.camera) {
    for (int k = 0; k < 3; ++k) {
      eye.pos[k] = static_cast<float>(view.X_WC.p[k]);
      eye.forward[k] = static_cast<float>(-R(k, 2));
      eye.up[k] = static_cast<float>(R(k, 1));
    }
    eye.frustum_center = 0;
    eye.frustum_top = static_cast<float>(eye.frustum_near * std::tan(view.fovy / 2));
    eye.frustum_bottom = -eye.frustum_top;
  }
}

}  // namespace

struct Renderer::Impl {
  std::shared_ptr<const Scene> scene;
  RendererConfig config;
  std::unique_ptr<GlContext> gl;         // before what lives in it
  std::unique_ptr<RenderContext> frame;  // of the scene's camera
  mjvScene drawing{};
  mjvOption option{};
  mjvCamera camera{};
  std::string gl_renderer;
  Appearance appearance;
  std::optional<Camera> moved;  // instead of the scene's camera
  int table_geom = -1, table_texture = -1, background = -1;
  bool has_background = false;
  std::vector<std::uint8_t> segments;

  ~Impl() {
    mjv_freeScene(&drawing);
    if (gl) gl->MakeCurrent();
  }

  Status Init();
  void Update(const World& world);
  const Camera& view_from() const { return moved ? *moved : scene->camera(); }
  void Dress();  ///< the drawing as `appearance` says
  void DressLights();
  void DressTable(mjvGeom& geom) const;
  void DressBody(mjvGeom& geom) const;
  void Draw(std::uint8_t* rgb);
};

Status Renderer::Impl::Init() {
  const Scene::Model& model = scene->model();
  const Camera& view = scene->camera();
  frame = std::make_unique<RenderContext>(model.mj.get(), view.width, view.height, config.samples);
  if (!frame->offscreen())
    return Fail(Code::kUnavailable, fmt::format("the {} driver has no off-screen framebuffer of {}x{} px",
                                                gl->backend(), view.width, view.height));
  mjv_defaultScene(&drawing);
  mjv_makeScene(model.mj.get(), &drawing, model.mj->ngeom + model.mj->nsite + kBesidesGeoms);
  drawing.flags[mjRND_SHADOW] = config.shadows;
  drawing.flags[mjRND_REFLECTION] = 0;
  const mjModel& mj = *model.mj;
  has_background = std::find(mj.tex_type, mj.tex_type + mj.ntex, mjTEXTURE_SKYBOX) != mj.tex_type + mj.ntex;
  drawing.flags[mjRND_SKYBOX] = has_background;
  drawing.flags[mjRND_HAZE] = 0;
  drawing.flags[mjRND_FOG] = 0;
  mjv_defaultOption(&option);
  mjv_defaultCamera(&camera);
  camera.type = mjCAMERA_FIXED;
  camera.fixedcamid = mj_name2id(model.mj.get(), mjOBJ_CAMERA, view.name.c_str());
  ETUDE_CHECK(camera.fixedcamid >= 0, "camera {}", view.name);
  table_geom = mj_name2id(&mj, mjOBJ_GEOM, assets::kTableGeom);
  background = TextureOf(mj, assets::kBackgroundTexture);
  return {};
}

void Renderer::Impl::Update(const World& world) {
  ETUDE_CHECK(&world.scene() == scene.get(), "the world belongs to another scene");
  gl->MakeCurrent();
  // MuJoCo asks for mutable data but changes nothing without perturbations
  mjv_updateScene(scene->model().mj.get(), world.state().mj.get(), &option, nullptr, &camera, mjCAT_ALL, &drawing);
  if (moved) Aim(drawing, *moved);
  Dress();
}

void Renderer::Impl::Dress() {
  DressLights();
  for (int i = 0; i < drawing.ngeom; ++i) {
    mjvGeom& geom = drawing.geoms[i];
    if (geom.objtype != mjOBJ_GEOM) continue;
    if (geom.objid == table_geom) DressTable(geom);
    DressBody(geom);
  }
}

void Renderer::Impl::DressLights() {
  for (int i = 0; i < drawing.nlight; ++i) {
    mjvLight& light = drawing.lights[i];
    for (int k = 0; k < 3; ++k)
      for (float* part : {light.ambient, light.diffuse, light.specular})
        part[k] *= static_cast<float>(appearance.light[k]);
    if (!light.directional || light.headlight || appearance.sun_shift.isZero(0)) continue;
    Eigen::Map<Eigen::Vector3f> direction(light.dir);
    direction = (direction + appearance.sun_shift.cast<float>()).normalized();
  }
}

void Renderer::Impl::DressTable(mjvGeom& geom) const {
  if (table_texture >= 0) geom.texid = table_texture;
  for (float& times : geom.texrepeat) times /= static_cast<float>(appearance.table_scale);
  for (int k = 0; k < 3; ++k) geom.rgba[k] *= static_cast<float>(appearance.table_colour[k]);
}

void Renderer::Impl::DressBody(mjvGeom& geom) const {
  const mjModel& model = *scene->model().mj;
  const auto root = static_cast<std::size_t>(model.body_rootid[model.geom_bodyid[geom.objid]]);
  for (int k = 0; k < 3 && root < appearance.tint.size(); ++k)
    geom.rgba[k] *= static_cast<float>(appearance.tint[root][k]);
  if (root >= appearance.gloss.size()) return;
  for (float* shine : {&geom.specular, &geom.shininess})
    *shine = std::clamp(*shine + static_cast<float>(appearance.gloss[root]), 0.0F, 1.0F);
}

void Renderer::Impl::Draw(std::uint8_t* rgb) {
  const Camera& view = view_from();
  const mjrRect area{0, 0, view.width, view.height};
  frame->Use();
  if (background >= 0) frame->Paint(*scene->model().mj, background, appearance.background);
  mjr_render(area, &drawing, frame->get());
  mjr_readPixels(rgb, nullptr, area, frame->get());
  FlipRows(rgb, static_cast<std::size_t>(view.width) * 3, view.height);
}

RendererConfig RendererFor(const CampaignSpec& spec, RendererConfig base) {
  base.renderer = spec.renderer;
  base.device = spec.device;
  return base;
}

Renderer::Renderer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Renderer::Renderer(Renderer&&) noexcept = default;
Renderer& Renderer::operator=(Renderer&&) noexcept = default;
Renderer::~Renderer() = default;

Result<Renderer> Renderer::Open(std::shared_ptr<const Scene> scene, const RendererConfig& config) {
  InstallHandlers();
  auto impl = std::make_unique<Impl>();
  impl->scene = std::move(scene);
  impl->config = config;
  ETUDE_ASSIGN_OR_RETURN(impl->gl, GlContext::Open({config.backend, config.renderer, config.device}));
  ETUDE_RETURN_IF_ERROR(impl->Init());
  impl->gl_renderer = impl->gl->DriverName();
  return Renderer(std::move(impl));
}

void Renderer::SetAppearance(const Appearance& appearance) {
  const mjModel& model = *impl_->scene->model().mj;
  impl_->table_texture = appearance.table.empty() ? -1 : TextureOf(model, appearance.table);
  ETUDE_CHECK(appearance.table.empty() || impl_->table_texture >= 0, "the scene has no table '{}'", appearance.table);
  ETUDE_CHECK(!appearance.background || impl_->background >= 0, "the scene has no backdrop");
  impl_->appearance = appearance;
}

void Renderer::SetCamera(const std::optional<Camera>& camera) {
  const Camera& own = impl_->scene->camera();
  ETUDE_CHECK(!camera || (camera->width == own.width && camera->height == own.height), "{}x{}", own.width, own.height);
  impl_->moved = camera;
}

const Camera& Renderer::camera() const { return impl_->view_from(); }

void Renderer::Render(const World& world, std::span<std::uint8_t> rgb) {
  const Camera& view = impl_->view_from();
  ETUDE_CHECK(rgb.size() == static_cast<std::size_t>(view.width) * view.height * 3, "{} bytes", rgb.size());
  impl_->Update(world);
  impl_->Draw(rgb.data());
}

void Renderer::RenderSegmentation(const World& world, std::span<std::int32_t> body_ids) {
  const Camera& view = impl_->view_from();
  const std::size_t pixels = static_cast<std::size_t>(view.width) * view.height;
  ETUDE_CHECK(body_ids.size() == pixels, "{} ids", body_ids.size());
  impl_->Update(world);
  mjvScene& drawing = impl_->drawing;
  impl_->segments.resize(pixels * 3);
  drawing.flags[mjRND_SEGMENT] = drawing.flags[mjRND_IDCOLOR] = 1;
  drawing.flags[mjRND_SKYBOX] = 0;
  impl_->Draw(impl_->segments.data());
  drawing.flags[mjRND_SEGMENT] = drawing.flags[mjRND_IDCOLOR] = 0;
  drawing.flags[mjRND_SKYBOX] = impl_->has_background;
  // colours are segment ids plus one; ids are in the drawn order, not the model's
  std::vector<std::int32_t> body_of(static_cast<std::size_t>(drawing.ngeom) + 1, -1);
  for (int i = 0; i < drawing.ngeom; ++i) {
    const mjvGeom& geom = drawing.geoms[i];
    if (geom.objtype == mjOBJ_GEOM && geom.segid >= 0 && geom.segid < drawing.ngeom)
      body_of[geom.segid + 1] = impl_->scene->model().mj->geom_bodyid[geom.objid];
  }
  const std::uint8_t* rgb = impl_->segments.data();
  for (std::size_t i = 0; i < pixels; ++i, rgb += 3) {
    const std::size_t id = rgb[0] | rgb[1] << 8 | rgb[2] << 16;
    body_ids[i] = id < body_of.size() ? body_of[id] : -1;
  }
}

void Renderer::RenderDepth(const World& world, std::span<float> depth) {
  const Camera& view = impl_->view_from();
  ETUDE_CHECK(depth.size() == static_cast<std::size_t>(view.width) * view.height, "{} values", depth.size());
  impl_->Update(world);
  const mjrRect area{0, 0, view.width, view.height};
  impl_->frame->Use();
  mjr_render(area, &impl_->drawing, impl_->frame->get());
  mjr_readPixels(nullptr, depth.data(), area, impl_->frame->get());
  FlipRows(depth.data(), static_cast<std::size_t>(view.width), view.height);
  // GL's depth is hyperbolic between the two planes, which MuJoCo gives in units of the model's extent
  const mjModel& model = *impl_->scene->model().mj;
  const double near = model.vis.map.znear * model.stat.extent, far = model.vis.map.zfar * model.stat.extent;
  for (float& z : depth) z = static_cast<float>(near / (1 - static_cast<double>(z) * (1 - near / far)));
}

const std::string& Renderer::backend() const { return impl_->gl->backend(); }
const std::string& Renderer::gl_renderer() const { return impl_->gl_renderer; }

}  // namespace etude::sim
