#include "client/convert.hpp"

namespace flockstep::client {

using namespace detail;

namespace {

Angles value_of(const protocol::Angles& angles) {
  return {.roll_deg = angles.roll_deg, .pitch_deg = angles.pitch_deg, .yaw_deg = angles.yaw_deg};
}

Vector3 read_location(Call& call) { return detail::value_of(ReplyOf<protocol::Vector3>(call).message()); }

Rotation read_rotation(Call& call) {
  ReplyOf<protocol::Rotation> reply(call);
  if (!reply.message().angles) refuse_reply("a reply lacks angles");
  return {.quaternion = required(reply.message().quaternion, "quaternion"), .angles = value_of(*reply.message().angles)};
}

bool read_move_line_visible(Call& call) { return ReplyOf<protocol::MoveLineVisible>(call).message().visible; }

}  // namespace

DroneController::DroneController(Connection connection, std::int64_t drone) : link_(std::move(connection.link_)), drone_(drone) {}

Future<void> DroneController::ping(Later) { return {link_->send(request_of(protocol::Ping{})), read_done}; }

// -------------------------------------------------------------------------------------------------------------------- motion

Future<Vector3> DroneController::get_location(Later) {
  return {link_->send(request_of(protocol::GetLocation{.drone = drone_})), read_location};
}

Future<Impact> DroneController::set_location(Later, const Vector3& location, bool teleport) {
  return {link_->send(request_of(
              protocol::SetLocation{.drone = drone_, .location = message_of(location, "location"), .teleport = teleport})),
          read_impact};
}

Future<Rotation> DroneController::get_rotation(Later) {
  return {link_->send(request_of(protocol::GetRotation{.drone = drone_})), read_rotation};
}

Future<Impact> DroneController::set_rotation(Later, const Orientation& rotation, bool teleport) {
  protocol::SetRotation message{.drone = drone_, .rotation = {}, .teleport = teleport};
  set(message.rotation, rotation);
  return {link_->send(request_of(message)), read_impact};
}

Future<Impact> DroneController::set_location_and_rotation(Later, const Vector3& location, const Orientation& rotation,
                                                          bool teleport) {
  protocol::SetLocationAndRotation message{
      .drone = drone_, .location = message_of(location, "location"), .rotation = {}, .teleport = teleport};
  set(message.rotation, rotation);
  return {link_->send(request_of(message)), read_impact};
}

Future<void> DroneController::set_command(Later, const std::array<float, 4>& command, std::string_view control) {
  return {link_->send(
              request_of(protocol::SetCommand{.drone = drone_, .control = std::string(control)}),
              [&](protocol::FrameWriter& writer) { writer.add("command", std::span<const float>(command), {command.size()}); }),
          read_done};
}

// -------------------------------------------------------------------------------------------------------------------- camera

Future<CameraData> DroneController::get_camera_data(Later, const ImageRequest& request) {
  return {link_->send(request_of(message_of(request, drone_))), read_image};
}

Stream<CameraData> DroneController::stream_camera(double rate_hz, const ImageRequest& request, bool only_new) {
  return {link_->subscribe({.rate_hz = finite(rate_hz, "rate_hz"), .what = message_of(request, drone_), .only_new = only_new}),
          read_image};
}

Future<std::string> DroneController::get_camera_config(Later, std::string_view camera) {
  return {link_->send(request_of(protocol::GetCameraConfig{.drone = drone_, .camera = std::string(camera)})), read_config};
}

Future<void> DroneController::set_camera_config(Later, std::string_view fields, std::string_view camera) {
  return {link_->send(request_of(
              protocol::SetCameraConfig{.drone = drone_, .camera = std::string(camera), .config_json = std::string(fields)})),
          read_done};
}

Future<bool> DroneController::get_move_line_visible(Later) {
  return {link_->send(request_of(protocol::GetMoveLineVisible{.drone = drone_})), read_move_line_visible};
}

Future<void> DroneController::set_move_line_visible(Later, bool visible) {
  return {link_->send(request_of(protocol::SetMoveLineVisible{.drone = drone_, .visible = visible})), read_done};
}

// --------------------------------------------------------------------------------------------------------------------- LiDAR

Future<LidarData> DroneController::get_lidar_data(Later, const ScanRequest& request) {
  return {link_->send(request_of(message_of(request, drone_))), read_scan};
}

Stream<LidarData> DroneController::stream_lidar(double rate_hz, const ScanRequest& request, bool only_new) {
  return {link_->subscribe({.rate_hz = finite(rate_hz, "rate_hz"), .what = message_of(request, drone_), .only_new = only_new}),
          read_scan};
}

Future<std::string> DroneController::get_lidar_config(Later, std::string_view lidar) {
  return {link_->send(request_of(protocol::GetLidarConfig{.drone = drone_, .lidar = std::string(lidar)})), read_config};
}

Future<void> DroneController::set_lidar_config(Later, std::string_view fields, std::string_view lidar) {
  return {link_->send(request_of(
              protocol::SetLidarConfig{.drone = drone_, .lidar = std::string(lidar), .config_json = std::string(fields)})),
          read_done};
}

}  // namespace flockstep::client
