//! A field of a section with its `#[key(..)]`.

use super::range::limit;
use proc_macro2::TokenStream;
use quote::{format_ident, quote};
use syn::meta::ParseNestedMeta;
use syn::{Attribute, Expr, Ident, Lit, LitStr, Meta, Type, Visibility};

pub(crate) struct Field {
    pub(crate) name: Ident,
    pub(crate) ty: Type,
    /// The form of an enum to which the field belongs.
    form: Option<Ident>,
    visibility: Visibility,
    docs: Vec<Attribute>,
    others: Vec<Attribute>,
    limits: Vec<TokenStream>,
    default: Option<Expr>,
    recipe: Option<Expr>,
    /// The default in words, if its expression does not say it.
    shown: Option<LitStr>,
    is_written: bool,
    decides: bool,
    pub(crate) line_only: bool,
    pub(crate) recipe_only: bool,
}

impl Field {
    pub(crate) fn read(field: syn::Field, form: Option<&Ident>) -> syn::Result<Self> {
        let name = field.ident.expect("a section has named fields");
        let mut read = Self {
            name,
            ty: field.ty,
            form: form.cloned(),
            visibility: field.vis,
            docs: vec![],
            others: vec![],
            limits: vec![],
            default: None,
            recipe: None,
            shown: None,
            is_written: false,
            decides: false,
            line_only: false,
            recipe_only: false,
        };
        for attribute in field.attrs {
            if attribute.path().is_ident("doc") {
                read.docs.push(attribute);
            } else if attribute.path().is_ident("key") {
                read.read_key(&attribute)?;
            } else {
                read.others.push(attribute);
            }
        }
        if read.docs.is_empty() {
            return Err(syn::Error::new_spanned(
                &read.name,
                "a key needs a doc comment: its text in tables",
            ));
        }
        Ok(read)
    }

    fn read_key(&mut self, attribute: &Attribute) -> syn::Result<()> {
        let Meta::List(list) = &attribute.meta else {
            return Err(syn::Error::new_spanned(attribute, "expected #[key(..)]"));
        };
        // A range comes first, because it has no name.
        let mut rest = list.tokens.clone();
        let mut tokens = rest.clone().into_iter();
        if let Some(first) = tokens.next()
            && let Ok(range) = syn::parse2::<LitStr>(TokenStream::from(first))
        {
            for part in range.value().split(';') {
                let limit = limit(part.trim()).map_err(|e| syn::Error::new(range.span(), e))?;
                self.limits.push(limit);
            }
            tokens.next();
            rest = tokens.collect();
        }
        let parser = syn::meta::parser(|meta: ParseNestedMeta<'_>| {
            let name = meta.path.require_ident()?.to_string();
            match name.as_str() {
                "default" => self.default = Some(meta.value()?.parse()?),
                "recipe" => self.recipe = Some(meta.value()?.parse()?),
                "shown" => self.shown = Some(meta.value()?.parse()?),
                "written" => self.is_written = true,
                "decides" => self.decides = true,
                "line_only" => self.line_only = true,
                "recipe_only" => self.recipe_only = true,
                _ => return Err(meta.error("unknown property of a key")),
            }
            Ok(())
        });
        syn::parse::Parser::parse2(parser, rest)
    }

    /// Returns the name of the key behind that of its form.
    fn prefixed(&self) -> String {
        match &self.form {
            Some(form) => format!("{}_{}", form.to_string().to_lowercase(), self.name),
            None => self.name.to_string(),
        }
    }

    /// Returns the name of the constant that describes the key.
    pub(crate) fn key(&self) -> Ident {
        format_ident!("{}", self.prefixed().to_uppercase())
    }

    fn is(&self, wrapper: &str) -> bool {
        let Type::Path(path) = &self.ty else {
            return false;
        };
        path.path.segments.last().is_some_and(|segment| segment.ident == wrapper)
    }

    /// True if a line may omit the key without a declared default.
    fn is_optional(&self) -> bool {
        self.is("Option") || self.is("Vec")
    }

    pub(crate) fn may_be_missing_in_recipes(&self) -> bool {
        self.recipe.is_some() || self.default.is_some() || self.is_optional()
    }

    /// Returns the field of the line with the attributes of its reader and writer.
    pub(crate) fn of_line(&self, line: &Ident) -> TokenStream {
        let Self { name, ty, visibility, docs, others, .. } = self;
        let serde = if self.default.is_some() {
            let default = format!("{line}::{}", self.default_name());
            let skip = format!("{line}::{}", self.is_default_name());
            if self.is_written {
                quote!(#[serde(default = #default)])
            } else {
                quote!(#[serde(default = #default, skip_serializing_if = #skip)])
            }
        } else if self.is("Option") {
            quote!(#[serde(default, skip_serializing_if = "Option::is_none")])
        } else if self.is("Vec") {
            quote!(#[serde(default, skip_serializing_if = "Vec::is_empty")])
        } else {
            quote!()
        };
        let range = (!self.limits.is_empty()).then(|| {
            let describe = self.describe_name();
            quote!(#[schemars(transform = #line::#describe)])
        });
        quote!(#(#docs)* #(#others)* #serde #range #visibility #name: #ty)
    }

    fn default_name(&self) -> Ident {
        format_ident!("default_{}", self.prefixed())
    }

    fn is_default_name(&self) -> Ident {
        format_ident!("is_default_{}", self.prefixed())
    }

    fn describe_name(&self) -> Ident {
        format_ident!("describe_{}", self.prefixed())
    }

    /// Returns the functions of a line's default and of its schema.
    pub(crate) fn line_functions(&self) -> TokenStream {
        let (default, limits, describe) = (self.line_default(), &self.limits, self.describe_name());
        let describe = (!limits.is_empty()).then(|| {
            quote! {
                fn #describe(schema: &mut ::schemars::Schema) {
                    crate::limits::describe(schema, &[#(#limits),*]);
                }
            }
        });
        quote!(#default #describe)
    }

    fn line_default(&self) -> TokenStream {
        let Some(value) = &self.default else {
            return quote!();
        };
        let (ty, default, is_default) = (&self.ty, self.default_name(), self.is_default_name());
        let is_default = (!self.is_written).then(|| {
            quote! {
                fn #is_default(value: &#ty) -> bool {
                    *value == Self::#default()
                }
            }
        });
        quote! {
            fn #default() -> #ty {
                #value
            }

            #is_default
        }
    }

    /// Returns the value of a key that only lines have, in a line that a recipe draws.
    pub(crate) fn missing(&self) -> TokenStream {
        if self.default.is_some() {
            let default = self.default_name();
            quote!(Self::#default())
        } else {
            quote!(::std::default::Default::default())
        }
    }

    /// Returns the field of the recipe.
    pub(crate) fn of_recipe(&self, recipe: &Ident) -> TokenStream {
        let Self { name, ty, docs, .. } = self;
        let default = if self.recipe.is_some() || self.default.is_some() {
            let default = format!("{recipe}::{}", self.default_name());
            quote!(#[serde(default = #default)])
        } else if self.is("Option") {
            quote!(#[serde(default, skip_serializing_if = "Option::is_none")])
        } else {
            quote!()
        };
        let words = self.shown_default().map(|shown| {
            let shown = format!(" Default {shown}.");
            quote!(#[doc = #shown])
        });
        let visibility = self.form.is_none().then(|| quote!(pub));
        quote!(#(#docs)* #words #default #visibility #name: <#ty as crate::keys::Drawn>::Recipe)
    }

    /// Returns the function of a recipe's default.
    pub(crate) fn recipe_default(&self) -> TokenStream {
        if self.recipe.is_none() && self.default.is_none() {
            return quote!();
        }
        let (ty, default, value) = (&self.ty, self.default_name(), self.recipe_value());
        quote! {
            fn #default() -> <#ty as crate::keys::Drawn>::Recipe {
                #value
            }
        }
    }

    fn recipe_value(&self) -> TokenStream {
        let ty = &self.ty;
        match (&self.recipe, &self.default) {
            (Some(value), _) => quote!((#value).into()),
            (None, Some(value)) => quote!(<#ty as crate::keys::Drawn>::constant(#value)),
            (None, None) => quote!(::std::default::Default::default()),
        }
    }

    /// Returns the value of the field in the recipe's default.
    pub(crate) fn recipe_default_value(&self) -> TokenStream {
        if self.recipe.is_none() && self.default.is_none() {
            return quote!(::std::default::Default::default());
        }
        let default = self.default_name();
        quote!(Self::#default())
    }

    fn shown_default(&self) -> Option<String> {
        self.recipe.as_ref().or(self.default.as_ref()).map(|value| self.show(value))
    }

    fn show(&self, value: &Expr) -> String {
        self.shown.as_ref().map_or_else(|| shown(value), LitStr::value)
    }

    /// Returns the constant that describes the key.
    pub(crate) fn description(&self) -> TokenStream {
        let (key, name, limits) = (self.key(), self.name.to_string(), &self.limits);
        let text = self.docs.iter().filter_map(text_of).collect::<Vec<_>>().join(" ");
        let option = |text: Option<String>| {
            let some = text.map(|text| quote!(::std::option::Option::Some(#text)));
            some.unwrap_or_else(|| quote!(::std::option::Option::None))
        };
        let default = option(self.default.as_ref().map(|value| self.show(value)));
        let recipe = option(self.shown_default());
        let is_optional = self.is_optional();
        let Self { decides, line_only, recipe_only, .. } = self;
        quote! {
            const #key: crate::keys::Key = crate::keys::Key {
                name: #name,
                text: #text,
                limits: &[#(#limits),*],
                default: #default,
                recipe_default: #recipe,
                is_optional: #is_optional,
                decides: #decides,
                in_lines: !#recipe_only,
                in_recipes: !#line_only,
            };
        }
    }
}

/// Returns the text of a doc comment.
fn text_of(attribute: &Attribute) -> Option<String> {
    let Meta::NameValue(pair) = &attribute.meta else {
        return None;
    };
    match &pair.value {
        Expr::Lit(literal) => match &literal.lit {
            Lit::Str(text) => Some(text.value().trim().to_owned()),
            _ => None,
        },
        _ => None,
    }
}

/// Writes a default for readers: numbers as they are written by hand, lists in brackets, words in snake case.
fn shown(value: &Expr) -> String {
    match value {
        Expr::Lit(literal) => {
            let text = quote!(#literal).to_string();
            text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
        }
        Expr::Unary(unary) => format!("-{}", shown(&unary.expr)),
        Expr::Array(array) => {
            format!("[{}]", array.elems.iter().map(shown).collect::<Vec<_>>().join(", "))
        }
        Expr::Repeat(repeat) => {
            let length = &repeat.len;
            let length = quote!(#length).to_string().parse().unwrap_or(1);
            format!("[{}]", vec![shown(&repeat.expr); length].join(", "))
        }
        Expr::Path(path) => {
            path.path.segments.last().map_or(String::new(), |word| snake(&word.ident.to_string()))
        }
        // A distribution, such as `Param::Uniform([0.2, 0.6])`.
        Expr::Call(call) => {
            let (name, arguments) = (shown(&call.func), call.args.iter().map(shown));
            let arguments = arguments.collect::<Vec<_>>().join(", ");
            if name == "constant" { arguments } else { format!("{{ {name} = {arguments} }}") }
        }
        other => quote!(#other).to_string(),
    }
}

/// Returns the name of a variant as files have it.
pub(crate) fn snake(name: &str) -> String {
    let mut text = String::new();
    for (place, letter) in name.chars().enumerate() {
        if letter.is_uppercase() && place > 0 {
            text.push('_');
        }
        text.extend(letter.to_lowercase());
    }
    text
}
