// GetCameraData: takes a frame with the lock of the batch, or from a published copy, and compresses it aside.
#include <algorithm>
#include <utility>

#include "base/require.hpp"
#include "flockstep/batch_lock.hpp"
#include "formats/image.hpp"
#include "render/jpeg.hpp"
#include "service/service.hpp"

namespace flockstep::server {
namespace {

// Copies the colours of one drone's frame, from any layout, red, green and blue from row to row.
void copy_colors(const ArrayView& view, const CameraConfig& camera, std::size_t drone, Picture& picture) {
  picture.width_px = camera.image_width_px();
  picture.height_px = camera.image_height_px();
  const auto pixels = static_cast<std::size_t>(picture.width_px) * static_cast<std::size_t>(picture.height_px);
  const auto channels = static_cast<std::size_t>(std::max(view.info.columns, 1));
  const auto* const frame = static_cast<const std::uint8_t*>(view.data) + drone * pixels * channels;
  if (channels == 3 && camera.layout == ImageLayout::hwc) {
    picture.rgb.assign(frame, frame + 3 * pixels);
    return;
  }
  picture.rgb.resize(3 * pixels);
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
    for (std::size_t channel = 0; channel < 3; ++channel) {
      const std::size_t from = channels == 1 ? 0 : channel;
      picture.rgb[3 * pixel + channel] =
          frame[camera.layout == ImageLayout::chw ? from * pixels + pixel : channels * pixel + from];
    }
  }
}

std::string compress(const Picture& picture, const protocol::GetCameraData& get) {
  if (get.format == protocol::ImageFormat::kJpeg) {
    constexpr int kUsualQuality = 90;
    CameraConfig camera;  // determines the layout of an image
    camera.width_px = picture.width_px;
    camera.height_px = picture.height_px;
    return render::compress_rgb(picture.rgb.data(), camera, get.quality == 0 ? kUsualQuality : static_cast<int>(get.quality));
  }
  std::vector<std::uint8_t> rgba;
  rgba.reserve(picture.rgb.size() / 3 * 4);
  for (std::size_t i = 0; i < picture.rgb.size(); i += 3) {
    rgba.insert(rgba.end(), {picture.rgb[i], picture.rgb[i + 1], picture.rgb[i + 2], 255});
  }
  return encode_png(picture.width_px, picture.height_px, rgba);
}

}  // namespace

void Service::handle(const std::shared_ptr<Call>& call, const protocol::GetCameraData&) {
  std::optional<Picture> picture;
  std::optional<Workload::Mark> mark(std::in_place, workload_);
  const bool is_taken = executor_.try_run([&] {
    const std::optional<BatchLock> lock = BatchLock::try_lock(batch_);
    if (!lock) return false;
    guard(*call, [&] {
      follow_program();
      picture = take_frame(*call);
    });
    return true;
  });
  // A stream waits for the end of the step and then copies its frame. To publish all frames before each step would take longer.
  if (is_taken || (!call->is_of_stream && take_published_frame(*call, picture))) return compress_aside(call, std::move(picture));
  mark.reset();
  executor_.run_later([this, call] {
    std::optional<Picture> taken;
    guard(*call, [&] {
      const Hold hold(*this, false);
      follow_program();
      taken = take_frame(*call);
    });
    compress_aside(call, std::move(taken));
  });
}

std::optional<Picture> Service::take_frame(Call& call) {
  const auto& get = std::get<protocol::GetCameraData>(call.request.operation);
  const std::size_t drone = require_drone(get.drone), camera = batch_.camera(get.camera).index();
  require(get.quality <= 100, "quality", "a number in [0, 100]", get.quality);
  if (batch_.camera(camera).config().capture_mode == CaptureMode::on_demand ||
      batch_.camera(camera).images().frame_step[drone] < 0) {
    publisher_.publish(batch_, steps());  // no begin_change(): the same pose gives the same frame again
    batch_.camera(camera).capture(only(drone));
  }
  std::optional<Picture> picture = copy_frame(call, LiveArrays(batch_), batch_.camera(camera).config().name, drone);
  const MoveLineState& shown = batch_.move_lines().state();
  const bool has_lines = std::ranges::count(shown.move_line_visible, 1) + std::ranges::count(shown.beams_visible, 1) > 0;
  if (picture && get.output.empty() && has_lines) picture->rgb = batch_.camera(camera).picture(DroneIndex(get.drone));
  return picture;
}

std::optional<Picture> Service::copy_frame(Call& call, const ArraySource& arrays, const std::string& name, std::size_t drone) {
  const auto& get = std::get<protocol::GetCameraData>(call.request.operation);
  const CameraConfig& camera = *arrays.camera(name);
  const bool is_file = get.format != protocol::ImageFormat::kRaw;
  const std::string output = !get.output.empty() ? get.output : camera.outputs.rgb ? "rgb" : "grey";
  const std::optional<ArrayView> found = arrays.find(camera.name, output);
  std::string outputs;
  bool is_image = false;
  for_each_field(camera.outputs, [&](const auto& field, bool is_on) {
    if (is_on) outputs += (outputs.empty() ? "" : ", ") + std::string(field.name);
    is_image |= is_on && output == field.name;
  });
  require(is_image && found, "output", "an output of camera \"" + camera.name + "\" (" + outputs + ')', '"' + output + '"');
  require(!is_file || output == "rgb" || output == "grey", "output", "rgb or grey for a JPEG or PNG file; RAW gives the others",
          '"' + output + '"');
  auto& data = call.result<protocol::CameraData>();
  data.step = static_cast<const std::int64_t*>(arrays.find(camera.name, "frame_step")->data)[drone];
  data.width_px = static_cast<std::uint32_t>(camera.image_width_px());
  data.height_px = static_cast<std::uint32_t>(camera.image_height_px());
  if (is_file) {
    Picture picture{.rgb = pictures_.take()};
    copy_colors(*found, camera, drone, picture);
    return picture;
  }
  add_row(call.writer, "image", *found, drone);
  return std::nullopt;
}

bool Service::take_published_frame(Call& call, std::optional<Picture>& picture) {
  const auto& get = std::get<protocol::GetCameraData>(call.request.operation);
  const auto now = info();
  const auto known = get.camera.empty() && now->camera_configs.size() == 1
                         ? now->camera_configs.begin()
                         : std::ranges::find(now->camera_configs, get.camera, &CameraConfig::name);
  // Only a frame that the camera takes by itself. A copy has no lines.
  if (known == now->camera_configs.end() || known->capture_mode == CaptureMode::on_demand || has_lines_ || get.quality > 100)
    return false;
  const auto copy = publisher_.read(batch_, known->name);
  if (!copy || get.drone < 0 || get.drone >= copy->num_drones) return false;
  if (copy->camera(known->name)->capture_mode == CaptureMode::on_demand) return false;  // by then the program had set it
  const auto drone = static_cast<std::size_t>(get.drone);
  if (static_cast<const std::int64_t*>(copy->find(known->name, "frame_step")->data)[drone] < 0) return false;
  guard(call, [&] { picture = copy_frame(call, *copy, known->name, drone); });
  return true;
}

void Service::compress_aside(const std::shared_ptr<Call>& call, std::optional<Picture> picture) {
  if (!picture) return complete(call);
  run_compression_([this, call, picture = std::move(*picture)]() mutable {
    guard(*call, [&] {
      const auto& get = std::get<protocol::GetCameraData>(call->request.operation);
      const FileMemory::View view{get.camera + '.' + get.output, get.drone, static_cast<std::int32_t>(get.format), get.quality};
      call->writer.add_bytes("image", files_.file_of(view, picture, [&](const Picture& made) { return compress(made, get); }));
    });
    complete(call);
    pictures_.give_back(std::move(picture.rgb));
  });
}

}  // namespace flockstep::server
