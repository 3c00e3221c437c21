//! Where it flew and what it saw on the way.

use std::fmt::Write as _;

use super::folder::{Output, Picture, known_class};
use super::html::{escape, length};
use super::space::Space;

pub(super) fn where_it_flew(output: &Output, space: &Space) -> String {
    if space.is_empty() {
        return "<p class=\"note\">There is no pose and no truth to draw.</p>".into();
    }
    let truth = if output.has_truth() {
        "<span class=\"key truth\"><i></i>truth</span>"
    } else {
        "<span class=\"key\">no truth in this recording</span>"
    };
    let mut classes: Vec<&str> = output.planes.iter().filter(|plane| plane.gone_into.is_none()).map(|plane| plane.class.as_str()).collect();
    classes.sort_unstable();
    classes.dedup();
    let planes: String = classes.iter().map(|class| format!("<span class=\"key p-{class}\"><i></i>{class}</span>")).collect();
    let points = if output.points.is_empty() { "" } else { "<span class=\"key dots\"><i></i>points of the map</span>" };
    let trouble = if space.trouble.is_empty() { "" } else { "<span class=\"key trouble\"><i></i>degraded or lost</span>" };
    format!(
        "<p class=\"keys\"><span class=\"key way\"><i></i>libella</span>{truth}{trouble}<span class=\"key\">○ start ● end</span>{planes}{points}</p>\
         <div class=\"two\">{}{}</div>\
         <figure class=\"space\" id=\"space\"><figcaption><b>In space</b> <span class=\"unit\">drag or arrow keys turn, wheel or pinch zooms</span>\
         <span class=\"buttons\"><button type=\"button\" data-view=\"home\">reset</button><button type=\"button\" data-view=\"top\">top</button>\
         <button type=\"button\" data-view=\"side\">side</button>\
         <label><input type=\"checkbox\" data-show=\"truth\" checked=\"checked\"/>truth</label><label><input type=\"checkbox\" data-show=\"points\" checked=\"checked\"/>points</label>\
         <label><input type=\"checkbox\" data-show=\"planes\" checked=\"checked\"/>planes</label></span></figcaption>\
         <canvas id=\"view\" tabindex=\"0\" aria-label=\"the way flown in space\"></canvas></figure>",
        space.flat("top", "From above", 0, 1),
        space.flat("side", "From the side", 0, 2),
    )
}

pub(super) fn what_it_saw(output: &Output) -> String {
    if output.pictures.is_empty() {
        return String::new();
    }
    let pictures: String = output.pictures.iter().map(picture).collect();
    let mut classes: Vec<_> = output
        .pictures
        .iter()
        .flat_map(|picture| {
            let corners = picture.taken.corners.iter().filter_map(|corner| corner.plane.as_deref());
            corners.chain(picture.taken.planes.iter().map(|plane| plane.class.as_str())).map(known_class)
        })
        .collect();
    classes.sort_unstable();
    classes.dedup();
    let planes: String = classes
        .iter()
        .map(|class| format!("<span class=\"key p-{class}\"><i></i>on a {class}</span>").replace("a floor", "the floor"))
        .collect();
    let maps = if output.pictures.iter().any(|picture| picture.depth.is_some()) {
        "<span class=\"key\">below: depth of the network from near to far, and its standard deviation</span>"
    } else {
        ""
    };
    format!(
        "<p class=\"keys\"><span class=\"key known\"><i></i>corner with a depth</span><span class=\"key unknown\"><i></i>not known yet</span>{planes}\
         <span class=\"key\">tails: the last 10 images</span>{maps}</p><div class=\"pictures\">{pictures}</div>"
    )
}

fn picture(picture: &Picture) -> String {
    let [width, height] = picture.taken.size_px;
    let mut paths = String::new();
    for plane in &picture.taken.planes {
        let outline: Vec<String> = plane.outline_px.iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
        let _ = write!(paths, "<path class=\"plane p-{}\" d=\"M{}Z\"/>", known_class(&plane.class), outline.join("L"));
    }
    for corner in &picture.taken.corners {
        let class = match (&corner.plane, corner.depth_m) {
            (Some(plane), _) => format!("p-{}", known_class(plane)),
            (None, Some(_)) => "known".into(),
            (None, None) => "unknown".into(),
        };
        let Some([x, y]) = corner.trail_px.last() else { continue };
        if corner.trail_px.len() > 1 {
            let trail: Vec<String> = corner.trail_px.iter().map(|[x, y]| format!("{x:.0} {y:.0}")).collect();
            let _ = write!(paths, "<path class=\"trail {class}\" d=\"M{}\"/>", trail.join("L"));
        }
        let _ = write!(paths, "<circle class=\"{class}\" cx=\"{x:.0}\" cy=\"{y:.0}\" r=\"{}\"/>", width as f64 / 130.0);
    }
    let maps = [("depth", &picture.depth, &picture.taken.depth), ("sigma", &picture.sigma, &picture.taken.sigma)];
    let maps = maps.into_iter().filter_map(|(kind, uri, map)| {
        let (uri, map) = (uri.as_ref()?, map.as_ref()?);
        let end = |value: f64| if kind == "depth" { length(value) } else { format!("{:.0} %", 100.0 * value) };
        let name = if kind == "depth" { "depth of the network" } else { "its standard deviation" };
        Some(format!(
            "<div><img alt=\"{name}\" src=\"{uri}\"/><p class=\"scale {kind}\"><span>{}</span><i></i><span>{}</span></p></div>",
            end(map.range[0]),
            end(map.range[1])
        ))
    });
    let maps: String = maps.collect();
    let maps = if maps.is_empty() { String::new() } else { format!("<div class=\"maps\">{maps}</div>") };
    let known = picture.taken.corners.iter().filter(|corner| corner.depth_m.is_some()).count();
    let on_planes = picture.taken.corners.iter().filter(|corner| corner.plane.is_some()).count();
    let on_planes = if on_planes > 0 { format!(", {on_planes} on planes") } else { String::new() };
    let health = picture.taken.health.split('_').next().unwrap_or("");
    let alarm = if health == "tracking" { "" } else { " alarm" };
    format!(
        "<figure class=\"picture\"><div class=\"shot\"><img alt=\"image at {s:.1} s\" src=\"{}\"/>\
         <svg viewBox=\"0 0 {width} {height}\" aria-hidden=\"true\">{paths}</svg></div>{maps}\
         <figcaption><b>{s:.1} s</b> <span class=\"state{alarm}\">{}</span> {} corners, {known} with a depth{on_planes}</figcaption></figure>",
        picture.image,
        escape(health),
        picture.taken.corners.len(),
        s = picture.taken.seconds,
    )
}
