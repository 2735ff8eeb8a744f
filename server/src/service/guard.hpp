// Runs an operation, and makes a reply of its exception. An operation of a client that is gone does not run.
#pragma once

#include <new>
#include <stdexcept>
#include <string>
#include <variant>

#include "service/call.hpp"

namespace flockstep::server {

template <class Operation>
void guard(Call& call, const Operation& operation) {
  using protocol::Code;
  try {
    if (call.client->is_gone) throw Refusal(Code::kFailedPrecondition, "the client is gone");
    operation();
    if (std::holds_alternative<std::monostate>(call.reply.result)) call.result<protocol::Done>();
  } catch (const Refusal& error) {
    call.fail(error.code(), error.what());
  } catch (const std::invalid_argument& error) {
    call.fail(Code::kInvalidArgument, error.what());
  } catch (const std::bad_alloc&) {
    call.fail(Code::kResourceExhausted, "the server has not enough memory for this");
  } catch (const std::logic_error& error) {
    call.fail(Code::kFailedPrecondition, error.what());
  } catch (const std::runtime_error& error) {
    call.fail(Code::kFailedPrecondition, error.what());
  } catch (const std::exception& error) {
    const std::string text = error.what();  // of Python: with a traceback, whose paths are none of the client's business
    call.fail(Code::kInternal, text.substr(0, text.find('\n')));
  }
}

}  // namespace flockstep::server
